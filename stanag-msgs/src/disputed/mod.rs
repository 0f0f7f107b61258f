//! What sources are silent on or disagree about, and what this project took.

pub mod values;
