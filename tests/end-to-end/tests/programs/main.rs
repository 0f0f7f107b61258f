//! Whole programs: what is handed out (`documents`), ours beside other people's (`interop`), and ours together
//! (`processes`).

mod documents;
mod interop;
mod processes;
