"""Endpoints of MAVLink 2 with signing, without pymavlink and nothing of this project's code: subjects for `mavlink-check`, with a fault for each rule."""
