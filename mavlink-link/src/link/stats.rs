//! Named counters of one link: every frame ends in exactly one drop or delivery.

/// Declares the counters once, and lists them by name.
macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// What one link has seen and done since its start; each drop has its own name.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        pub struct LinkStats { $($(#[$doc])* pub $name: u64,)* }

        impl LinkStats {
            /// Every counter with its name, in a fixed order.
            pub fn iter(&self) -> impl Iterator<Item = (&'static str, u64)> + use<> {
                [$((stringify!($name), self.$name),)*].into_iter()
            }
        }
    };
}

counters! {
    /// Datagrams, or reads of a serial port.
    datagrams,
    /// Bytes in them.
    bytes,
    /// Frames with a right checksum.
    good_frames,
    /// Candidates with a wrong checksum.
    bad_crc,
    /// Frames with an unknown incompatibility flag.
    unknown_incompat,
    /// MAVLink 1 frames, refused.
    mavlink1,
    /// Frames of a message without known CRC_EXTRA that no signature vouches for.
    unknown_id,
    /// Frames whose end never came.
    truncated,
    /// Bytes outside any frame.
    garbage_bytes,
    /// Frames with our own system id.
    reflected,
    /// Frames of another system than the vehicle.
    unexpected_system,
    /// Signed frames of a stream that is not on the list of those taken.
    not_listed,
    /// Frames of component 1 with another link id than it has here.
    unexpected_link,
    /// Unsigned frames that carry the vehicle's system id, not on the list of those accepted.
    unsigned_vehicle,
    /// Unsigned frames on the list that came from elsewhere than the peer.
    unsigned_stranger,
    /// Frames with the vehicle's system id and a wrong signature.
    bad_signature,
    /// Verified frames of a stream for which there is no place.
    stream_table_full,
    /// Verified frames stamped more than an hour beyond our base.
    future,
    /// Verified frames stamped at or below the last accepted: replayed, reordered or fallen back.
    stale,
    /// Verified frames not accepted because the clock's ceiling could not be stored.
    ceiling_not_stored,
    /// Frames on an unsigned link from elsewhere than the peer.
    wrong_peer,
    /// Frames that came while no key was at hand.
    no_key,
    /// Frames delivered as verified.
    delivered_verified,
    /// Frames delivered unverified.
    delivered_unverified,
    /// Verified frames of which it is not known that they are younger than 60 s; delivered and marked.
    late,
    /// Delivered frames of a message the dialect does not know.
    undecoded_id,
    /// Delivered frames with a value or size the dialect's structs refuse.
    undecoded_value,
    /// KEY_EXCHANGE frames handed to the key exchange.
    key_exchange,
    /// Events lost because nobody polled for them.
    events_lost,
    /// Frames sent.
    sent,
    /// Bytes of them.
    sent_bytes,
    /// Heartbeats among them.
    sent_heartbeats,
    /// Frames not sent because the signing clock gave no stamp.
    send_refused,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_counter_is_listed_under_its_name() {
        let stats = LinkStats {
            stale: 7,
            ..LinkStats::default()
        };
        assert_eq!(
            stats.iter().filter(|&(_, n)| n > 0).collect::<Vec<_>>(),
            [("stale", 7)]
        );
    }
}
