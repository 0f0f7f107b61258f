//! What was measured, and what is assumed.

// `cargo bench -p vsm --bench fleet`, one run on two cores, each CUCS held to the default limit: docs/guide/performance.md.
/// CPU of a process, % of a core, with 200 vehicles (31 us a frame).
pub(super) const CORE_OF_200: f64 = 26.0;
/// With 1,000 (21 us a frame).
pub(super) const CORE_OF_1000: f64 = 85.0;
/// Its memory, MB.
pub(super) const MEMORY_OF_200: f64 = 28.0;
/// With 1,000.
pub(super) const MEMORY_OF_1000: f64 = 83.0;
/// Frames a second of a vehicle of that bench: HEARTBEAT at 1 Hz, four streams at 10 Hz.
pub(super) const FRAMES_S: f64 = 41.0;
/// CUCSs that listen to every vehicle of a VSM in that bench.
pub(super) const STATIONS: f64 = 3.0;

/// Reports a second of a vehicle to a station: 4000 at 5 Hz, 3001, 3002 and 4001 at 2.5 Hz, 16002 at 1 Hz
/// (`session/reports/push.rs`), as `VSM_FLEET_MINUTES=60 cargo test -p vsm --test hot_path memory` counted them.
pub(super) const REPORTS_S: f64 = 13.5;
/// `dli.max_messages_s` unless set.
pub(super) const MESSAGES_S: f64 = 1_000.0;
/// A report on the wire: 57 bytes on average where no field is absent, a CRC-32, and Ethernet, IPv4 and UDP around it.
pub(super) const DATAGRAM_BYTES: f64 = 57.0 + 4.0 + 46.0;

/// Take-overs that nobody ordered, by kind of fault: how many, p50 and longest, s, of
/// `cargo xtask faults --times 220 --seed 4588 --vehicles 3 --side-by-side 4` (docs/reference/fleet-faults.md).
pub(super) const TAKE_OVERS: [(usize, f64, f64); 6] = [
    (7, 2.96, 3.61),
    (13, 2.80, 4.18),
    (21, 3.03, 4.26),
    (11, 2.74, 3.82),
    (9, 3.03, 5.62),
    (13, 2.78, 6.04),
];
/// None is shorter than what is left of a lease of 3 s that is renewed each second.
pub(super) const SHORTEST_S: f64 = 2.0;
/// The longest of all.
pub(super) const LONGEST_S: f64 = 6.04;
/// Vehicles of a VSM in that run.
pub(super) const MEASURED_WITH: u32 = 3;
/// `COM_DL_LOSS_T` of PX4, unless set.
pub(super) const LOSS_S: f64 = 10.0;

/// A ceiling is stored 10 s ahead, again when 4 s are left (`mavlink-link/src/signing/clock.rs`): each 6 s.
pub(super) const CEILING_S: f64 = 6.0;
/// The same, a second.
pub(super) const CEILINGS_S: f64 = 1.0 / CEILING_S;
/// How long a ceiling may take before frames wait.
pub(super) const ROOM_S: f64 = 4.0;
/// The database of etcd 3.4.23 grows by so many bytes with each ceiling, until it is compacted: 2,500 requests of
/// `shell::fleet::remote`, the size of the database before and after.
pub(super) const CEILING_BYTES: f64 = 541.0;
/// Puts and deletions of such a request: a piece, a head, the piece before, the mark of the last change.
pub(super) const CHANGES: f64 = 4.0;
/// Assumed: a command a minute for each vehicle. It stores a record and a line of a log.
pub(super) const COMMANDS_S: f64 = 1.0 / 60.0;
/// Two such requests, and half of the log's last piece of 4,096 bytes. Not measured.
pub(super) const COMMAND_BYTES: f64 = 2.0 * CEILING_BYTES + 2_048.0;
/// Files of a vehicle that the next node reads: ceiling, rights, plan, link id, two audit logs.
pub(super) const FILES: f64 = 6.0;

// etcd's page "Performance" (three members of 8 vCPUs and SSDs, values of 256 bytes).
/// Writes a second of 1,000 clients, and reads.
pub(super) const ETCD_S: f64 = 44_341.0;
pub(super) const READS_S: f64 = 141_578.0;
/// One read of one client, s.
pub(super) const READ_S: f64 = 0.000_7;
/// One write of one client, 1.6 ms, behind an fsync of the node's own SSD, 1 ms there.
pub(super) const WRITE_S: f64 = 0.001_6 + 0.001;
pub(super) const GIB: f64 = 1_073_741_824.0;

/// Values that may be sealed with one key (`shell/fleet/seal.rs`, NIST SP 800-38D, 8.3). A request seals two.
pub(super) const SEALS: f64 = 4_294_967_296.0;
pub(super) const YEAR_S: f64 = 365.0 * 86_400.0;

/// Assumed: the node that serves a VSM, and two that stand by for it, drawn for each.
pub(super) const NODES_OF_VSM: u32 = 3;
/// Assumed: cores of a node.
pub(super) const NODE_CORES: f64 = 2.0;
pub(super) const TRIALS: u32 = 1_000;
