//! The system's allocator with counters: how often this thread allocates, and how much it holds.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// Made the `#[global_allocator]` of a test program.
#[derive(Debug)]
pub struct Counting;

// Counted by thread, so that parallel tests in one program do not disturb each other.
thread_local! {
    static CALLS: Cell<u64> = const { Cell::new(0) };
    static HELD: Cell<i64> = const { Cell::new(0) };
}

/// How often `work` allocates on this thread.
pub fn allocations<T>(work: impl FnOnce() -> T) -> (u64, T) {
    let before = CALLS.with(Cell::get);
    let done = work();
    (CALLS.with(Cell::get) - before, done)
}

/// Bytes that this thread has allocated and not freed yet.
pub fn held() -> i64 {
    HELD.with(Cell::get)
}

// SAFETY: every call is passed on unchanged to the system's allocator.
#[allow(unsafe_code, reason = "counting allocations needs an allocator")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.with(|n| n.set(n.get() + 1));
        HELD.with(|held| held.set(held.get() + layout.size() as i64));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.with(|held| held.set(held.get() - layout.size() as i64));
        unsafe { System.dealloc(pointer, layout) }
    }
}
