//! Why areas are refused: which area, which of its vertices, and what is wrong.

/// Areas that make no fence, or a message that makes no area. Area 0 is one of the configuration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("area {area}{}: {reason}", of(.vertex))]
pub struct AreaError {
    /// Area ID.
    pub area: u16,
    /// Vertex Number, where it is about one.
    pub vertex: Option<u8>,
    /// Why.
    pub reason: Reason,
}

/// What is wrong with an area.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Reason {
    /// A field that must be there is not.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A type that there is not.
    #[error("Area Type {0}, expected 0 to 3")]
    Type(u8),
    /// A number of corners that the type does not have.
    #[error("Vertex Count {0}, expected {1}")]
    Count(u8, &'static str),
    /// A corner beyond the count.
    #[error("Vertex Number {0}, expected 1 to {1}")]
    Number(u8, u8),
    /// No place on earth.
    #[error("latitude {0:.4} deg, expected -90 to 90")]
    Latitude(f64),
    /// A circle without size.
    #[error("Radius {0} m, expected more than 0 and at most 100000")]
    Radius(f64),
    /// A corner that has not been received.
    #[error("it has not been received")]
    NotReceived,
    /// The same place twice in turn, or sides that cross.
    #[error("its sides cross, or it has no inside")]
    Outline,
    /// More than the vehicle holds.
    #[error("{0} vertices with the areas before it, the vehicle holds 64")]
    TooMany(usize),
    /// It would make the configured space larger.
    #[error("areas to stay inside are set by the configuration of this VSM")]
    Widens,
    /// The vehicle would break the fence where it is.
    #[error("the vehicle is {0} it now")]
    Breached(&'static str),
    /// Nothing at all to load.
    #[error("no area has been received (50016)")]
    None,
}

fn of(vertex: &Option<u8>) -> String {
    vertex.map_or_else(String::new, |number| format!(" vertex {number}"))
}
