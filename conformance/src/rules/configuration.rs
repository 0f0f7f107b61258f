//! Configuration phase: CONF.

use stanag_msgs::Id;

use super::Scene;
use crate::wire::Draft;

pub(super) const SCENES: &[Scene] = &[];

/// 40000 of this request type.
pub(super) fn request(kind: i64) -> Draft {
    Draft::new(40000)
        .id("VSM ID", Id::BROADCAST)
        .raw("Data Link ID", 0)
        .raw("Request Type", kind)
}
