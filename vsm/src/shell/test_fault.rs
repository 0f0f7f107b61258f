//! Breaks a task on purpose, for tests: only in builds with debug assertions, which no package has.
//!
//! `VSM_TEST_FAULT="KIND TASK"` in the environment breaks the task with this name a while after its start. KIND is one of
//!
//! - `panic`: it panics;
//! - `end`: it returns;
//! - `block`: it waits forever, as on a socket that accepts nothing;
//! - `freeze`: it keeps the thread, as an endless loop does.

use std::future::Future;

/// The task, broken if the environment requests it.
#[cfg(debug_assertions)]
pub(super) async fn broken(task: &'static str, work: impl Future<Output = ()>) {
    use std::time::Duration;

    let order = std::env::var("VSM_TEST_FAULT").unwrap_or_default();
    let kind = match order.split_once(' ') {
        Some((kind, name)) if name == task => kind,
        _ => return work.await,
    };
    // Late enough for the bridge to have reported that it serves.
    let mut work = std::pin::pin!(work);
    if tokio::time::timeout(Duration::from_millis(1_500), &mut work)
        .await
        .is_ok()
    {
        return;
    }
    match kind {
        "panic" => panic!("VSM_TEST_FAULT: {task} panics"),
        "block" => std::future::pending().await,
        "freeze" => std::thread::sleep(Duration::from_secs(3_600)),
        _ => {}
    }
}

/// The task.
#[cfg(not(debug_assertions))]
pub(super) fn broken<F: Future<Output = ()>>(_: &'static str, work: F) -> F {
    work
}
