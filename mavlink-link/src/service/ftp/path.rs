//! Paths on the vehicle.

use super::payload::MAX_DATA;

/// A path on the vehicle: 1 to 238 bytes without control characters, and without a component `..`.
///
/// `@MAV_LOG` at its beginning is PX4's folder of logs, wherever that is.
#[derive(Clone, PartialEq, Eq, Debug, Hash, PartialOrd, Ord)]
pub struct FilePath(String);

/// A text that is no path for the vehicle.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum PathError {
    /// Nothing, or more than a message holds with its terminator.
    #[error("path {0:?} has {1} bytes: expected 1 to {MAX_PATH}")]
    Length(String, usize),
    /// PX4 ends a path at a zero byte, and a listing could not show the others.
    #[error("path {0:?} has a control character: expected none")]
    Control(String),
    /// PX4 before v1.18 would leave its root folder.
    #[error("path {0:?} has a component \"..\": name the folder itself")]
    Parent(String),
}

impl FilePath {
    /// A path.
    ///
    /// # Errors
    /// It is too long, empty, has control characters, or leads upwards.
    pub fn new(path: &str) -> Result<Self, PathError> {
        if path.is_empty() || path.len() > MAX_PATH {
            return Err(PathError::Length(path.to_owned(), path.len()));
        }
        if path.chars().any(char::is_control) {
            return Err(PathError::Control(path.to_owned()));
        }
        if path.split(['/', '\\']).any(|part| part == "..") {
            return Err(PathError::Parent(path.to_owned()));
        }
        Ok(Self(path.to_owned()))
    }

    /// Its text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The last component; `None` for a folder's path with a slash at the end.
    #[must_use]
    pub fn file_name(&self) -> Option<&str> {
        let name = self.0.rsplit('/').next()?;
        (!name.is_empty() && name != ".").then_some(name)
    }
}

impl std::fmt::Display for FilePath {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// Room for the terminator that PX4 appends.
const MAX_PATH: usize = MAX_DATA - 1;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_never_leads_upwards() {
        for bad in ["..", "../a", "/fs/../etc", "log/..", "a\\..\\b"] {
            assert!(
                matches!(FilePath::new(bad), Err(PathError::Parent(_))),
                "{bad}"
            );
        }
        for good in ["/fs/microsd/log", "@MAV_LOG/a.ulg", "..hidden", "a..b", "/"] {
            assert_eq!(FilePath::new(good).unwrap().as_str(), good);
        }
    }

    #[test]
    fn a_path_fits_a_message_with_its_terminator() {
        assert!(FilePath::new(&"a".repeat(238)).is_ok());
        assert!(matches!(
            FilePath::new(&"a".repeat(239)),
            Err(PathError::Length(_, 239))
        ));
        assert!(matches!(FilePath::new(""), Err(PathError::Length(_, 0))));
        assert!(matches!(FilePath::new("a\0b"), Err(PathError::Control(_))));
    }
}
