"""One vehicle behind the VSM: its parts, and which of them handles which message of a CUCS."""
import math

from . import alerts as alert
from . import mission as plans
from . import units
from .aircraft import Aircraft
from .alerts import Alerts
from .authority import (CONTROL, FAILED, HANDOVER_S, IN_PROGRESS, LOI_2, LOI_3, LOI_4, LOI_5, RELEASE, SUCCESSFUL, ACT_S, OFFER_S, WARN_S, Authority, Handover,
                        Wish)
from .configuration import Configuration
from .mission import Mission
from .payload import Payloads
from .reports import OF_VEHICLE, REPORTS, subsystems
from .steering import DONE, Outcome, Steering, refused
from .wire import signed, unsigned

WGS84, SEA_LEVEL = 3, 1
LINK_LOST_S = 2.0
SAMPLE_S = 0.05
# A Time Stamp further than this from the clock cannot be from a station that keeps time.
CLOCK_S = 60.0
STORES = (13001, 13002, 13003, 50001, 50002)
COMMANDS = {2000: LOI_4, 2005: LOI_5, 2007: LOI_4, 2008: LOI_5, 2010: LOI_4, 2017: LOI_4, 13000: LOI_4, 34000: 0, **dict.fromkeys(STORES, LOI_4),
            **dict.fromkeys((13004, 13005, 13006), LOI_4), 15000: 0, 15001: 0, 17001: LOI_2, 17002: 0, 19001: LOI_3, 19100: LOI_3, 40000: 0, 4: 0, 28000: 0}
# Of two of these the one with the later stamp stays, whichever arrives last.
ORDERED = {2000, 2007, 2016, 2017, 19001, 19100}


class Vehicle:
    """The parts of one vehicle. `vsm` sends, keeps time and knows the stations."""

    def __init__(self, vsm, number):
        self.vsm, self.options, self.number = vsm, vsm.options, number
        self.real_id = self.options.vehicle_id + number
        self.id = self.logical_id = number + 1
        self.type, self.subtype = self.options.vehicle_type, self.options.vehicle_subtype
        self.tail_number = self.options.tail_number if number == 0 else f"{self.options.tail_number}-{number + 1}"
        self.call_sign = f"SECOND {number + 1}"
        home = units.moved(self.options.home[:2], 0.0, 200.0 * number)
        self.aircraft = Aircraft(home, self.options.home[2], self.options.geoid, math.radians(self.options.variation), self.options.wind,
                                 vsm.dice.uniform(-math.pi, math.pi))
        self.aircraft.fix = self.options.fix
        self.payloads = Payloads(self, self.options.stations)
        self.authority = Authority(vsm.access, self.payloads.mask)
        self.alerts = Alerts(self.announce, vsm.dice.randrange(1, 10_000))
        self.mission = Mission(self, self.report, self.plan_changed, lambda id, text: self.alerts.refusal(id, text, self.now()))
        self.steering = Steering(self)
        self.configuration = Configuration(self, self.send_together)
        self.last_request, self.link_holder, self.energy = {}, None, {}
        self.pending = []
        self.link_up, self.link_seen, self.link_lost = self.options.link, -1e9, True
        self.sampled = units.stamp()
        self._mode_sent = None
        if self.link_up:
            self.connect(first=True)

    # What the parts ask

    def now(self):
        return self.vsm.now()

    @property
    def vsm_id_field(self):
        return signed(self.options.vsm_id)

    def source(self):
        """The id under which this vehicle's reports go out."""
        return self.id

    def above_sea(self, altitude, kind):
        """Metres above the sea of an altitude in one of the four references."""
        return {2: altitude + self.aircraft.ground, WGS84: altitude - self.aircraft.geoid}.get(kind, altitude)

    def altitude_type(self):
        return WGS84

    def altitude_field(self, altitude):
        return round(altitude / units.ALTITUDE_STEP_M)

    def reported_altitude(self, above_sea):
        """An altitude in the reference of `altitude_type`."""
        return self.altitude_field(above_sea + self.aircraft.geoid)

    def reported_heading(self, heading):
        return heading

    def down_speed(self, up):
        return units.fine(-up)

    def unknown_position(self):
        return {}

    def granted_field(self, cucs):
        return self.authority.granted(cucs)

    def unreachable(self):
        return "the link to the vehicle is down" if self.link_lost else None

    # Sending

    def report(self, cucs, id, fields, ack=False):
        self.vsm.send(cucs, self.source(), id, fields, ack)

    def announce(self, fields):
        for cucs in self.authority.watching():
            self.report(cucs, 16000, fields)

    def send_together(self, cucs, messages):
        self.vsm.send_together(cucs, self.source(), messages)

    def send_report(self, cucs, id, mask=0, wanted=0):
        """A status message, or several where there are several to report; whether it could be sent."""
        if id not in REPORTS or (id in OF_VEHICLE and not self.status_is_fresh()):
            return False
        for fields in REPORTS[id](self, cucs, mask):
            if wanted:
                fields = self.vsm.only(id, fields, wanted)
            for name_id, names in self.configuration.describing(cucs, id, fields):
                self.report(cucs, name_id, names)
            self.report(cucs, id, {"Time Stamp": self.stamp_of(id), **fields})
        return True

    def stamp_of(self, id):
        """When the data of a report were captured."""
        return self.sampled if id in OF_VEHICLE else units.stamp()

    def status_is_fresh(self):
        return not self.link_lost

    # Time

    def advance(self, dt):
        """One sample of the aircraft, and what waits for it."""
        now = self.now()
        self.aircraft.advance(dt * self.options.speed)
        self.payloads.advance(dt)
        if self.link_up:
            self.link_seen, self.sampled = now, units.stamp()
        self.watch_link(now)
        self.watch_station(now)
        self.mission.tick(now)
        self.configuration.tick()
        self.alerts.tick(now)
        self.confirm(now)
        self.lapse(now)
        self.report_changes()

    def report_changes(self):
        mode = self.steering.reported_mode()
        if mode != self._mode_sent and self.status_is_fresh():
            self._mode_sent = mode
            for cucs in self.authority.watching():
                self.send_report(cucs, 3001)
        for id, fields in self.configuration.changed():
            for cucs in self.authority.watching():
                self.report(cucs, id, fields)

    def watch_link(self, now):
        lost = now - self.link_seen > LINK_LOST_S
        if lost and not self.link_lost:
            self.link_lost = True
            self.alerts.raise_("link", alert.WARNING, alert.COMMS, f"no data from vehicle {self.tail_number}: state unknown", now)
            if not self.authority.watching():
                self.rename(self.logical_id)
        elif not lost and self.link_lost:
            self.connect()

    def connect(self, first=False):
        """The vehicle is there: its real id replaces the logical one."""
        self.link_lost = False
        self.link_seen = self.now()
        if first:
            self.id = self.real_id
            return
        self.alerts.clear("link")
        if self.id != self.real_id:
            self.rename(self.real_id)

    def rename(self, id):
        """Another id for this vehicle; #3 goes out under the old one."""
        for cucs in self.vsm.peers:
            self.report(cucs, 3, {**REPORTS[3](self, cucs, 0)[0], "Vehicle ID Update": signed(id),
                                  "Tail Number": self.tail_number if id == self.real_id else "0"})
        self.id = id

    def plan_changed(self):
        """Another plan is aboard, perhaps with another Mission ID."""
        for cucs in self.authority.watching():
            self.send_report(cucs, 3)

    # Authority

    def authorise(self, message, discovery):
        """#1: a discovery, a request, a release."""
        cucs, fields, now = message.source, message.fields, self.now()
        a = self.authority
        self.last_request[cucs] = fields
        if not discovery:
            before, holder, offered = a.granted(cucs), a.holder(), a.handover
            self.change_rights(cucs, fields, now)
            self.after_change(cucs, before, holder, offered)
        self.send_report(cucs, 2)
        return Outcome() if discovery or a.granted(cucs) & fields.get("Requested/Handover LOI", 0) or not fields.get(
            "Requested/Handover Access", 0) else refused("1: the request is denied")

    def change_rights(self, cucs, fields, now):
        loi, access = fields.get("Requested/Handover LOI", 0), fields.get("Requested/Handover Access", 0)
        stations = fields.get("Controlled Station 1-16", 0) | fields.get("Controlled Station 17-32", 0) << 16
        a = self.authority
        if access == RELEASE:
            wish = a.wish
            a.release(cucs, loi, stations, now)
            if wish and not wish.for_link and a.holder() is None:
                self.consent(cucs, wish)
        elif fields.get("Wait for Vehicle Data Link Transition Coordination Message", 0) == 1 and loi & CONTROL & a.authorised(cucs):
            a.wish = Wish(cucs, loi & a.authorised(cucs), stations, now + HANDOVER_S, for_link=True)
            self.handover_step(IN_PROGRESS, a.holder() or 0, cucs)
        elif access in (1, 2):
            a.request(cucs, loi, access, stations, now)

    def after_change(self, cucs, before, holder, handover):
        """What everybody has to know about a change of rights."""
        a = self.authority
        if a.handover is not handover and a.handover.status == SUCCESSFUL:
            for status in (IN_PROGRESS, SUCCESSFUL):
                self.handover_step(status, a.handover.giving, a.handover.taking)
        if holder not in (None, cucs) and a.holder() != holder:
            self.send_report(holder, 2)
        if a.holder() != holder:
            self.mission.drop_upload()
            self.alerts.clear("silence")
        if a.granted(cucs) and not before:
            for fields in self.alerts.standing():
                self.report(cucs, 16000, fields)
        if a.granted(cucs) != before:
            if not a.granted(cucs):
                # Its next connection begins without heartbeats.
                self.vsm.peers[cucs].heartbeats = False
            self.vsm.save()

    def handover_step(self, status, giving, taking):
        self.authority.handover = Handover(status, giving, taking)
        for cucs in {giving, taking} - {0}:
            self.send_report(cucs, 35000)

    def positive_handover(self, message):
        """#4: the wish of a CUCS to take over, or the holder's consent to one."""
        cucs, fields, now, a = message.source, message.fields, self.now(), self.authority
        loi = fields.get("Requested/Handover LOI", 0)
        if a.controls(cucs):
            successor = unsigned(fields.get("Requesting CUCS ID", 0))
            if a.wish and successor in (a.wish.cucs, 0):
                if not loi & CONTROL:
                    self.fail_handover("refused")
                    return DONE
                self.consent(cucs, a.wish)
                return DONE
            if successor not in a.access or not loi & a.authorised(successor) & CONTROL:
                return refused("4: the named successor may not control this vehicle")
            self.consent(cucs, Wish(successor, loi & a.authorised(successor), 0, now))
            return DONE
        allowed = loi & a.authorised(cucs)
        if not allowed & CONTROL:
            return refused(f"4: LOI bits {loi:#x} are not authorised for this CUCS: expected bits of {a.authorised(cucs):#x}")
        wish = Wish(cucs, allowed, 0, now + HANDOVER_S)
        holder = a.holder()
        if holder is None:
            self.consent(cucs, wish)
            return DONE
        a.wish = wish
        self.handover_step(IN_PROGRESS, holder, cucs)
        self.report(holder, 4, {**fields, "Time Stamp": units.stamp(), "Requesting CUCS ID": signed(cucs)})
        return Outcome(shown=lambda: a.holder() == cucs, within=HANDOVER_S)

    def consent(self, giving, wish):
        """Control passes to whoever wished for it."""
        a = self.authority
        before, holder = a.granted(wish.cucs), a.holder()
        if holder is not None:
            a.take_from(holder)
        a.wish = None
        a.give(wish.cucs, wish.loi & (CONTROL | LOI_2))
        self.send_report(wish.cucs, 2)
        self.send_granted(wish.cucs, wish.loi)
        if giving not in (wish.cucs, 0):
            self.send_report(giving, 2)
        self.handover_step(SUCCESSFUL, giving if giving != wish.cucs else 0, wish.cucs)
        self.after_change(wish.cucs, before, None if holder == wish.cucs else holder, a.handover)

    def send_granted(self, cucs, loi):
        """#5"""
        self.report(cucs, 5, {"VSM ID": self.vsm_id_field, "Data Link ID": 0, "LOI Authorized": loi, "Flight Mode Offset": 0, "Flight Modes Authorized": 0,
                              "Controlled Station 1-16 Authorized": 0, "Component Number Authorized": 0, "Sub-Component Number Authorized": 0,
                              "Vehicle Type": self.type, "Vehicle Subtype": self.subtype, "Requesting CUCS Type": 0, "Requesting CUCS Subtype": 0,
                              "Requesting CUCS ID": signed(cucs), "Presence Vector Support": 1, "Controlled Station 17-32 Authorized": 0})

    def fail_handover(self, _why):
        wish, self.authority.wish = self.authority.wish, None
        self.handover_step(FAILED, self.authority.holder() or 0, wish.cucs)
        if not wish.for_link:
            self.send_granted(wish.cucs, 0)

    def lapse(self, now):
        wish = self.authority.wish
        if wish and now > wish.until:
            self.fail_handover("no answer")

    def transit(self, message):
        """34000: the data link passes to the acquiring CUCS."""
        fields, a = message.fields, self.authority
        for name in ("Set Forward Link Carrier Frequency (ADT)", "Set Return Link Carrier Frequency (ADT)"):
            if not math.isfinite(fields.get(name, 0.0)):
                return refused(f"34000: {name} is no number")
        if a.holder() not in (None, message.source) or not a.authorised(message.source) & CONTROL:
            return refused("34000: sent by a CUCS that is not in control")
        wish = a.wish
        if not wish or unsigned(fields.get("Acquiring CUCS ID", 0)) != wish.cucs:
            return refused("34000: no CUCS waits for this transition")
        self.consent(a.holder() or 0, wish)
        return DONE

    def watch_station(self, now):
        """A controlling CUCS that sent heartbeats and fell silent."""
        a = self.authority
        holder = a.holder()
        peer = self.vsm.peers.get(holder)
        if peer is None or not peer.heartbeats:
            return
        silent = now - peer.received
        if silent < WARN_S:
            self.alerts.clear("silence")
            a.offered = False
        elif silent >= ACT_S:
            a.take_from(holder)
            a.offered, peer.heartbeats = False, False
            self.alerts.raise_("silence", alert.WARNING, alert.COMMS, f"controlling CUCS silent for {ACT_S:.0f} s: control taken; action: {self.options.on_loss}", now)
            self.send_report(holder, 2)
            self.mission.drop_upload()
            self.steering.lose_station(self.options.on_loss)
            self.vsm.save()
        elif silent >= OFFER_S:
            a.offered = True
            self.alerts.raise_("silence", alert.WARNING, alert.COMMS, f"controlling CUCS silent for {OFFER_S:.0f} s: control is on offer", now)
        else:
            self.alerts.raise_("silence", alert.CAUTION, alert.COMMS, f"controlling CUCS silent for {WARN_S:.0f} s", now)

    # Commands

    def handles(self, id):
        return id == 2016 or id in COMMANDS

    def loi_needed(self, message):
        return self.steering.loi_needed(message.fields) if message.id == 2016 else COMMANDS[message.id]

    def permits(self, message):
        """A reason where the CUCS does not hold what the command needs."""
        needed = self.loi_needed(message)
        if message.id in (19001, 19100):
            mask = self.payloads.mask_of(message.fields)
            return None if self.payloads.may_command(message.source, mask) else f"{message.id}: no LOI 3 for stations {mask:#06x}"
        if needed == LOI_2:
            return None if self.authority.granted(message.source) else f"{message.id}: no LOI is held"
        if needed and not self.authority.has(message.source, needed):
            return f"{message.id}: LOI {needed.bit_length() + 1} is not held"
        return None

    def handle(self, message):
        """Carries out one command; the outcome decides the acknowledgement."""
        fields, cucs = message.fields, message.source
        direct = {2017: self.steering.configure_loiter, 2016: self.steering.command_mode, 2010: self.steering.move_sticks,
                  2007: self.steering.switch_lights, 2008: self.steering.command_engine, 19001: self.payloads.steer, 19100: self.payloads.set}
        if message.id in direct:
            outcome = direct[message.id](fields)
            if message.id == 2007 and outcome.reason is None:
                self.send_report(cucs, 3006)
            return outcome
        return {2000: self.set_energy, 2005: self.terminate, 13000: self.transfer, 34000: self.transit, 15000: self.report_subsystems,
                15001: lambda m: refused(f"15001: there is no report {m.fields.get('Subsystem State Report Reference')}"), 17001: self.schedule,
                17002: self.answer, 40000: self.configure, 4: self.positive_handover, 28000: self.assign_link,
                **dict.fromkeys(STORES, self.store), **dict.fromkeys((13004, 13005, 13006), lambda m: refused(f"{m.id}: not supported"))}[message.id](message)

    def set_energy(self, message):
        self.energy.update({k: v for k, v in message.fields.items() if k != "Time Stamp"})
        return DONE

    def terminate(self, message):
        outcome = self.steering.terminate(message.fields)
        for cucs in self.authority.watching():
            self.send_report(cucs, 3005)
        return outcome

    def store(self, message):
        if message.id == 50001 and (unsigned(message.fields.get("Vehicle ID", 0)), unsigned(message.fields.get("CUCS ID", 0))) != (
                message.destination, message.source):
            self.mission.upload.problem = "50001: Vehicle ID and CUCS ID differ from those of the wrapper"
            return refused(self.mission.upload.problem)
        problem = self.mission.store(message.id, message.fields)
        return refused(problem) if problem else DONE

    def transfer(self, message):
        problem = self.mission.command(message.source, message.fields, self.now())
        if problem:
            return refused(problem)
        begun = self.mission.transfer
        if begun is None or begun.mode != plans.LOAD:
            return DONE
        return Outcome(shown=lambda: self.mission.aboard is begun.plan, within=60.0)

    def report_subsystems(self, message):
        for fields in subsystems(self, message.fields.get("Subsystem ID", 0)):
            self.report(message.source, 16001, fields)
        return DONE

    def schedule(self, message):
        id, frequency = message.fields.get("Requested Message Type", 0), message.fields.get("Frequency", 0)
        if id not in REPORTS:
            return refused(f"17001: message {id} is not reported")
        self.vsm.schedule(message.source, self, id, frequency)
        return DONE

    def answer(self, message):
        f = message.fields
        id = f.get("Message Type", 0)
        mask = f.get("Station Number 1-16", 0) | f.get("Station Number 17-32", 0) << 16
        return DONE if self.send_report(message.source, id, mask, f.get("Requested Field Presence Vector", 0)) else refused(
            f"17002: message {id} is not reported" if id not in REPORTS else f"17002: {self.unreachable()}")

    def configure(self, message):
        problem = self.configuration.request(message.source, message.fields)
        return refused(problem) if problem else DONE

    def assign_link(self, message):
        """28000, in which 0 requests and 1 releases."""
        release = message.fields.get("Control Assignment Request", 0) == 1
        broadcast = unsigned(message.fields.get("Data Link ID", 0)) == 0xFFFFFFFF
        if not broadcast:
            if release and self.link_holder == message.source:
                self.link_holder = None
            elif not release and self.link_holder is None:
                self.link_holder = message.source
        elif self.link_holder == message.source:
            # A question is never answered with "granted".
            self.report(message.source, 28001, {**REPORTS[28001](self, message.source, 0)[0], "Data Link Control Availability": 1})
            return DONE
        self.send_report(message.source, 28001)
        return DONE

    # Acknowledgement

    def await_state(self, message, outcome):
        self.pending.append((message, outcome, self.now() + outcome.within / min(1.0, self.options.speed)))

    def confirm(self, now):
        for item in list(self.pending):
            message, outcome, until = item
            if outcome.shown():
                self.pending.remove(item)
                self.vsm.acknowledge(message, self, 2)
            elif now > until or self.link_lost:
                self.pending.remove(item)
                self.vsm.acknowledge(message, self, 3)
                self.alerts.refusal(message.id, f"{message.id}: the vehicle has not done it within {outcome.within:.0f} s", now)
