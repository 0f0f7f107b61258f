//! MAVLink 2 frames, signing, the peer lock and the PX4 services, without sockets or clock.
