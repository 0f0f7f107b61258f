//! Plans as they are stored: 13001 to 13003 and curves before they are answered, and what is aboard over a restart.

use stanag_msgs::enums::AckType;
use stanag_msgs::{Id, Message};

use crate::session::aircraft::Aircraft;
use crate::session::alerts::Cause;
use crate::session::desk::{Desk, Origin};
use crate::session::plan_record;
use crate::session::store::{record_fault, record_name};
use mavlink_link::store::{Durability, MAX_RECORD_BYTES, StoreError};

impl Aircraft {
    /// 13001, 13002, 13003, 50001, 50002: stored at once, flown after 13000.
    pub(crate) fn store_plan_message(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        message: &Message,
    ) {
        let Some(cucs) = desk
            .stations
            .get(origin.station)
            .map(|station| station.id())
        else {
            return;
        };
        let before = self.plan.clone();
        let stored = self
            .plan
            .store(message, cucs, self.id())
            .map_err(|fault| fault.to_string())
            .and_then(|()| {
                self.save_plan(desk, cucs)
                    .map_err(|fault| format!("it cannot be stored: {fault}"))
            });
        match stored {
            Ok(()) => desk.acknowledge(self.id(), &origin, AckType::CarriedOut),
            Err(why) => {
                self.plan = before;
                self.refuse(desk, Some(origin), why);
            }
        }
    }

    /// The vehicle may hold something else than what was loaded: nothing is flown before the next load.
    pub(super) fn forget_aboard(&mut self, desk: &mut Desk<'_>) {
        self.aboard = None;
        if let Err(fault) = self.save_aboard(desk) {
            self.warn(
                desk,
                Cause::Store,
                format!("the plan cannot be stored: {fault}"),
            );
        }
    }

    pub(super) fn save_plan(&self, desk: &mut Desk<'_>, cucs: Id) -> Result<(), StoreError> {
        let bytes = plan_record::encode_plan(&self.plan, cucs, self.id());
        desk.store
            .replace(&record_name("plan", self.id()), &bytes, Durability::Process)
    }

    pub(super) fn save_aboard(&self, desk: &mut Desk<'_>) -> Result<(), StoreError> {
        for (kind, route) in [("chosen", &self.loaded_mission), ("aboard", &self.aboard)] {
            let bytes = route.as_ref().map_or_else(Vec::new, |route| {
                plan_record::encode_aboard(route, self.id())
            });
            desk.store
                .replace(&record_name(kind, self.id()), &bytes, Durability::Power)?;
        }
        Ok(())
    }

    /// What a restart finds: authority, plan, and what is aboard.
    ///
    /// # Errors
    /// A record is there and cannot be read: starting without it would lose what was promised.
    pub(crate) fn restore(&mut self, desk: &mut Desk<'_>) -> Result<(), StoreError> {
        let id = self.id();
        self.restore_authority(desk)?;
        if let Some(bytes) = desk
            .store
            .read(&record_name("plan", id), MAX_RECORD_BYTES)?
            .filter(|bytes| !bytes.is_empty())
        {
            self.plan = plan_record::decode_plan(&bytes, id)
                .map_err(|cause| record_fault("plan", id, cause))?;
        }
        for (kind, route) in [
            ("aboard", &mut self.aboard),
            ("chosen", &mut self.loaded_mission),
        ] {
            let bytes = desk.store.read(&record_name(kind, id), MAX_RECORD_BYTES)?;
            if let Some(bytes) = bytes.filter(|bytes| !bytes.is_empty()) {
                let read = plan_record::decode_aboard(&bytes, id)
                    .map_err(|cause| record_fault(kind, id, cause))?;
                *route = Some(read);
            }
        }
        self.restore_fence(desk)?;
        self.restore_altimeter(desk)
    }
}
