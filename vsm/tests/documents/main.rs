//! What the documents promise is true: every field of the support table, and every test that the pages on security name.

mod promises;
mod scene;
mod sent;
mod support_table;
mod trials;
