//! A scriptable CUCS: the ground station's side of the Data Link Interface.
