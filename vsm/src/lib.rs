//! The bridge: sessions, shell and the vsm program.
