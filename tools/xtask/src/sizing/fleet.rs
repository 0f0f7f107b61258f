//! A fleet, and what one of its VSMs costs.

use super::costs::{
    CORE_OF_200, CORE_OF_1000, ETCD_S, FILES, MEASURED_WITH, MEMORY_OF_200, MEMORY_OF_1000,
    MESSAGES_S, READ_S, READS_S, REPORTS_S, STATIONS, WRITE_S,
};

#[derive(Debug, Clone, Copy)]
pub(super) struct Fleet {
    pub(super) vehicles: u32,
    pub(super) nodes: u32,
    pub(super) of_vsm: u32,
}

impl Fleet {
    /// The last VSM counts as a full one.
    pub(super) fn vsms(&self) -> u32 {
        self.vehicles.div_ceil(self.of_vsm)
    }

    /// Of a core, %, as long as each station is held to the default limit.
    pub(super) fn vsm_core(&self) -> f64 {
        line(self.of_vsm, CORE_OF_200, CORE_OF_1000)
    }

    /// The memory of its process, MB.
    pub(super) fn vsm_memory(&self) -> f64 {
        line(self.of_vsm, MEMORY_OF_200, MEMORY_OF_1000)
    }

    /// How many datagrams a second a VSM sends to all its stations, at the default limit.
    pub(super) fn vsm_datagrams(&self) -> f64 {
        (f64::from(self.of_vsm) * REPORTS_S).min(MESSAGES_S) * STATIONS
    }

    /// How long the last vehicle of a VSM waits beyond what was measured with three: the next node reads every file, and
    /// then stores every ceiling, one after the other. `lanes`: VSMs that do so at once.
    pub(super) fn restore_s(&self, lanes: u32) -> f64 {
        let lanes = f64::from(lanes);
        let (read, write) = (READ_S.max(lanes / READS_S), WRITE_S.max(lanes / ETCD_S));
        f64::from(self.of_vsm.saturating_sub(MEASURED_WITH)) * (FILES * read + write)
    }
}

/// The line through the measured figures of 200 and of 1,000 vehicles in one process.
fn line(vehicles: u32, of_200: f64, of_1000: f64) -> f64 {
    of_200 + (of_1000 - of_200) * (f64::from(vehicles) - 200.0) / 800.0
}

/// The fleet of the guide.
#[cfg(test)]
pub(super) const FLEET: Fleet = Fleet {
    vehicles: 10_000,
    nodes: 20,
    of_vsm: 100,
};
