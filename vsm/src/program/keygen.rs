//! `vsm keygen`.

use std::path::Path;

use crate::shell::key_file;

use super::process::{Failure, failed, print};

pub(crate) fn generate(path: &Path) -> Result<(), Failure> {
    key_file::generate(path).map_err(failed)?;
    let key = key_file::read(path).map_err(failed)?;
    let text = format!("{}: a new key, id {}\n", path.display(), key.id());
    print(&text)
}
