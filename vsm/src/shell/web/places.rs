//! Which connection makes room for the next, of the page and of the WebSocket.

/// Which of these places, the oldest first, is given to a newcomer: one of the host that has most of them, the newcomer counted; of
/// these the oldest that is idle, or the oldest. `held`: of each its host ([`crate::session::computer_of`]), and whether it is idle.
pub(super) fn makes_room(held: &[(u64, bool)], newcomer: u64) -> Option<usize> {
    let of = |host: u64| {
        let places = held.iter().filter(|(one, _)| *one == host).count();
        places + usize::from(host == newcomer)
    };
    // Of equal ones the last that is looked at is taken: the oldest.
    let places = held.iter().enumerate().rev();
    let least = places.max_by_key(|(_, (host, idle))| (of(*host), *idle));
    least.map(|(at, _)| at)
}
