//! What is handed out: the commands of the documents (`pages`) and the Debian package (`package`).

mod package;
mod pages;
