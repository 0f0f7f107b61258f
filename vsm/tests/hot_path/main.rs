//! Memory: nothing is allocated for a message that passes through the bridge, and what fifty vehicles need does not grow.
//!
//! A test program of its own, because it counts with an allocator of its own.

mod allocations;
mod memory;

use kit::heap::Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;
