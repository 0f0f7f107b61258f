//! Each refusal of an area.

/// Areas that make no fence, or a message that makes no area.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{}{reason}", place(.area, .configured, .vertex))]
pub struct AreaError {
    /// Area ID; 0 of one of the configuration, and where it is about none.
    pub area: u16,
    /// Which of the configuration it is, from 1.
    pub configured: Option<usize>,
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
    /// A side across 180 degrees of longitude.
    #[error(
        "its side to the next vertex spans {0:.1} deg of longitude, expected at most 180: PX4 keeps no polygon across 180 deg, use a \
         circle"
    )]
    Across180(f64),
    /// More than the vehicle holds.
    #[error("{0} vertices with the areas before it, the vehicle holds 64")]
    TooMany(usize),
    /// It would make the configured space larger.
    #[error(
        "areas to stay inside are set by the configuration of this VSM, and this vehicle allows every one of them, as PX4 before v1.15"
    )]
    Widens,
    /// The vehicle, or its home, is on the wrong side of it.
    #[error("{0} is currently {1} it: PX4 leaves such an area out")]
    Breached(&'static str, &'static str),
    /// Nothing at all to load.
    #[error("no area has been received (50016)")]
    None,
}

/// `area 7 vertex 3: `, as far as it is about one.
fn place(area: &u16, configured: &Option<usize>, vertex: &Option<u8>) -> String {
    let area = match (configured, area) {
        (Some(number), _) => Some(format!("area {number} of the configuration")),
        (None, 0) => None,
        (None, id) => Some(format!("area {id}")),
    };
    let vertex = vertex.map(|number| format!("vertex {number}"));
    let parts: Vec<String> = area.into_iter().chain(vertex).collect();
    if parts.is_empty() {
        return String::new();
    }
    format!("{}: ", parts.join(" "))
}
