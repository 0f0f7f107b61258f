//! What the subcommands share: reading the profile.

use std::path::Path;

use crate::profile::Profile;

/// The profile of a file, or the default.
pub(super) fn profile(file: Option<&Path>) -> Result<Profile, String> {
    match file {
        Some(file) => Profile::read(file).map_err(|error| error.to_string()),
        None => Ok(Profile::default()),
    }
}
