//! Conformance, interoperability and end-to-end tests.
