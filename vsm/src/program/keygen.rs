//! `vsm keygen`.

use std::io::{self, Write};
use std::path::Path;

use crate::shell::key_file;
use anyhow::anyhow;

use super::Failure;

pub(crate) fn generate(path: &Path) -> Result<(), Failure> {
    key_file::generate(path).map_err(|fault| Failure::Failed(anyhow!(fault)))?;
    let key = key_file::read(path).map_err(|fault| Failure::Failed(anyhow!(fault)))?;
    let text = format!("{}: a new key, id {}\n", path.display(), key.id());
    io::stdout()
        .write_all(text.as_bytes())
        .map_err(|fault| Failure::Failed(fault.into()))
}
