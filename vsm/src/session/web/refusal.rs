//! Why a web client is refused, or its connection ends: the counter in the status, and the code of the WebSocket's close frame.

/// A way to be refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WebRefusal {
    /// A page of another origin.
    Origin,
    /// Asked by another name than one of this page.
    Host,
    /// As many are connected as may be.
    Many,
    /// It has not said who it is in time.
    NoHello,
    /// No station of this id may come by the web.
    Unlisted,
    /// It has another key, or what it sends was recorded.
    Key,
    /// Its address is not the configured one.
    Address,
    /// A frame does not verify.
    Mac,
    /// A frame has another number than the next.
    Counter,
    /// A frame is too long.
    TooLarge,
    /// It reads slower than it is sent messages.
    TooSlow,
    /// It sends more than it may.
    Flood,
    /// What it sends is no frame.
    Form,
    /// Its key is no longer in force, or the client was removed from the configuration.
    KeyGone,
    /// A newer connection with its key exists.
    Replaced,
    /// Nothing comes from it.
    Dead,
    /// The bridge ends.
    Ends,
}

impl WebRefusal {
    /// Its counter.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            WebRefusal::Origin => "web: another origin",
            WebRefusal::Host => "web: another host",
            WebRefusal::Many => "web: too many connections",
            WebRefusal::NoHello => "web: no hello",
            WebRefusal::Unlisted => "web: id not listed for the web",
            WebRefusal::Key => "web: wrong key",
            WebRefusal::Address => "web: unauthorised address",
            WebRefusal::Mac => "web: wrong MAC",
            WebRefusal::Counter => "web: stale counter",
            WebRefusal::TooLarge => "web: too large",
            WebRefusal::TooSlow => "web: too slow",
            WebRefusal::Flood => "web: flood",
            WebRefusal::Form => "web: not a frame of this protocol",
            WebRefusal::KeyGone => "web: key replaced or revoked",
            WebRefusal::Replaced => "web: replaced by a newer connection",
            WebRefusal::Dead => "web: dead",
            WebRefusal::Ends => "web: the bridge ends",
        }
    }

    /// The code of the close frame. Whoever has not verified learns nothing of which ids are listed.
    #[must_use]
    pub const fn code(self) -> u16 {
        match self {
            WebRefusal::Ends => 1001,
            WebRefusal::Replaced => 4001,
            WebRefusal::NoHello
            | WebRefusal::Unlisted
            | WebRefusal::Key
            | WebRefusal::Address
            | WebRefusal::Origin
            | WebRefusal::Host
            | WebRefusal::Many => 4003,
            WebRefusal::Mac => 4004,
            WebRefusal::Counter => 4005,
            WebRefusal::TooLarge => 4006,
            WebRefusal::TooSlow | WebRefusal::Dead => 4007,
            WebRefusal::Flood => 4008,
            WebRefusal::Form => 4009,
            WebRefusal::KeyGone => 4010,
        }
    }

    /// The reason in the close frame.
    #[must_use]
    pub const fn reason(self) -> &'static str {
        match self.code() {
            4003 => "not authenticated",
            _ => self.name(),
        }
    }

    /// Whether it ends the connection of a client that has shown its key, and says nothing of another in its name.
    #[must_use]
    pub const fn is_of_verified(self) -> bool {
        matches!(
            self,
            WebRefusal::TooSlow
                | WebRefusal::KeyGone
                | WebRefusal::Replaced
                | WebRefusal::Dead
                | WebRefusal::Ends
        )
    }

    /// Whether it is no fault of anybody, and not counted.
    #[must_use]
    pub const fn is_usual(self) -> bool {
        matches!(self, WebRefusal::Ends)
    }
}
