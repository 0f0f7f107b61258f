//! Pure functions between STANAG 4586 and MAVLink: routes, modes, states.
