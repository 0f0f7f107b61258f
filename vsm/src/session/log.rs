//! Lines for the log, as the machines hand them to the shell.

use stanag_msgs::Id;
use stanag_msgs::enums::AlertPriority;

/// How much a log entry matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogLevel {
    /// What became of one datagram; only where [`Bridge::set_trace`](super::Bridge::set_trace) asks for it.
    Debug,
    /// No action is needed.
    Info,
    /// Something an operator should know.
    Warning,
    /// Something an operator must act on.
    Error,
}

impl LogLevel {
    pub(crate) fn of(priority: AlertPriority) -> LogLevel {
        match priority {
            AlertPriority::Emergency | AlertPriority::Failed => LogLevel::Error,
            AlertPriority::Warning | AlertPriority::Caution => LogLevel::Warning,
            _ => LogLevel::Info,
        }
    }
}

/// A line for the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogEntry {
    /// How much it matters.
    pub level: LogLevel,
    /// The vehicle, CUCS or VSM that it is about.
    pub about: Id,
    /// What happened.
    pub text: String,
}
