//! Cubic Bezier legs: definition, proven densification, fitting; and the planning program.
