//! Legs, their chords, fitted tracks and flights along them: each against an oracle, or against published figures.

mod everland;
mod fit;
mod flight;
mod leg;
mod oracle;
