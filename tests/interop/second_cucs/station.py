"""The second CUCS on the wire: discovery, rights, configuration, upload, commands; each confirmed, and repeated with the same bytes."""
import select
import socket
import time

from second_vsm import units
from second_vsm.wire import BROADCAST, Codec, signed, unsigned

from .display import MODE, Display

LOI_3, LOI_4, LOI_5 = 2, 4, 8
RELEASE, REQUEST, OVERRIDE = 0, 1, 2
ANSWER_S, ACK_S, LOAD_S, CONFIG_S = 2.0, 1.0, 60.0, 15.0
ATTEMPTS = 3
HEARTBEAT_S = 1.0
NEEDS_LOI_5 = (19, 20, 21)
HANDOVER_MESSAGE = 4


class Impossible(Exception):
    """The step cannot be done; the text says why."""


class Station:
    """One ground station. Everything it does goes through `send` and `take`."""

    def __init__(self, vsm, id, bind=("127.0.0.1", 0)):
        self.vsm, self.id = vsm, id
        self.codec, self.display = Codec("4", 2), Display()
        self.vehicle, self.vsm_id = None, -1
        self.inbox, self.last_stamp = [], 0
        self.heartbeat_at = None
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(bind)
        self.socket.setblocking(False)
        self.configured = False

    def now(self):
        return time.monotonic()

    # Sending

    def stamp(self):
        self.last_stamp = max(self.last_stamp + 1, units.stamp())
        return self.last_stamp

    def encode(self, id, fields, ack=False, to=None):
        destination = self.vehicle if to is None else to
        if destination is None:
            raise Impossible("no vehicle is known; discover first")
        return self.codec.encode(id, self.source(), destination, {"Time Stamp": self.stamp(), **fields}, ack)

    def source(self):
        return self.id

    def send(self, id, fields, ack=False, to=None):
        self.transmit(self.encode(id, fields, ack, to))

    def transmit(self, wire):
        self.socket.sendto(wire, self.vsm)

    # Receiving

    def pump(self, seconds):
        """Receives for so long, and keeps up what runs by itself."""
        end = self.now() + seconds
        while True:
            self.tick()
            left = end - self.now()
            readable, _, _ = select.select([self.socket], [], [], max(0.0, min(left, 0.1)))
            if readable:
                self.receive()
            elif left <= 0:
                return

    def tick(self):
        now = self.now()
        self.display.expire(now)
        if self.heartbeat_at is not None and now >= self.heartbeat_at and self.display.loi:
            self.heartbeat_at = now + HEARTBEAT_S
            self.send(16002, {})

    def receive(self):
        try:
            datagram, _ = self.socket.recvfrom(65535)
        except OSError:
            return
        self.take_datagram(datagram)

    def take_datagram(self, datagram):
        for message in self.codec.messages(datagram, lambda source: True):
            if message.destination in (self.id, BROADCAST) and message.source != self.id:
                self.inbox.append(message)
                self.take(message)

    def take(self, message):
        """One message of the VSM."""
        fields, now = message.fields, self.now()
        if message.ack and self.acknowledges(message):
            self.send(17000, {"Original Message Time Stamp": message.stamp or 0, "Original Message Type": message.id, "Acknowledgement Type": 1},
                      to=message.source)
        if self.vehicle is not None and message.source != self.vehicle:
            return
        if message.id == 2:
            self.take_rights(fields)
        elif message.id == 3 and "Vehicle ID Update" in fields and unsigned(fields["Vehicle ID Update"]) != self.vehicle:
            self.vehicle = unsigned(fields["Vehicle ID Update"])
        elif message.id == HANDOVER_MESSAGE:
            self.display.handover = unsigned(fields.get("Requesting CUCS ID", 0))
        elif message.id == 3001:
            self.display.show_mode(fields)
        elif message.id == 3002 and "Current Propulsion Energy Level" in fields:
            self.display.watch(3002, 12, fields["Current Propulsion Energy Level"])
        elif message.id == 4000:
            self.display.show_position(fields, now)
        elif message.id == 14000:
            self.take_status(fields)
        elif message.id == 16000:
            self.display.show_alert(fields, now)
        elif 41000 <= message.id <= 41004 or message.id == 44003:
            self.display.learn(message.id, fields)

    def acknowledges(self, message):
        return message.id != 17000

    def take_rights(self, fields):
        self.display.authorised = fields.get("LOI Authorized", self.display.authorised)
        self.display.loi = fields.get("LOI Granted", self.display.loi)

    def take_status(self, fields):
        if fields.get("Mission Plan Mode", 2) == 2:
            self.display.mission = {0: f"loading, {fields.get('Percent Complete', 0)} %", 1: "loaded", 2: "rejected"}.get(fields.get("Status"), "unknown")

    def wait(self, wanted, seconds, since):
        """The first message from `since` on that is wanted, or None."""
        end = self.now() + seconds
        while True:
            for message in self.inbox[since:]:
                if wanted(message):
                    return message
            if self.now() >= end:
                return None
            self.pump(0.05)

    # Steps

    def discover(self):
        for _ in range(ATTEMPTS):
            since = len(self.inbox)
            self.send(1, self.search(), to=BROADCAST)
            answer = self.wait(lambda m: m.id == 2, ANSWER_S, since)
            if answer:
                self.vehicle, self.vsm_id = answer.source, answer.fields.get("VSM ID", -1)
                self.take_rights(answer.fields)
                return
        raise Impossible("no vehicle answers")

    def search(self):
        """A discovery: everybody, no level, no access."""
        return self.request_fields(0, RELEASE) | {"VSM ID": -1}

    def request_fields(self, loi, access, stations=0):
        return {"VSM ID": self.vsm_id, "Data Link ID": 0, "Requested/Handover LOI": loi, "Requested/Handover Access": access,
                "Controlled Station 1-16": stations, "Presence Vector Support": 1}

    def ask_rights(self, loi, access=REQUEST, stations=0):
        since = len(self.inbox)
        for _ in range(ATTEMPTS):
            self.send(1, self.request_fields(loi, access, stations))
            if self.wait(lambda m: m.id == 2, ANSWER_S, since):
                return
        raise Impossible("the VSM does not answer the request")

    def take_control(self, loi=LOI_4, access=REQUEST, stations=0):
        self.ask_rights(loi, access, stations)
        if self.display.loi & loi != loi:
            raise Impossible(f"LOI bits {loi:#x} were not granted: {self.display.loi:#x} are held")

    def release(self):
        self.ask_rights(self.display.loi or 15, RELEASE)

    def must_hold(self, loi):
        """A command is sent only while the level that it needs is held."""
        if not self.display.loi & loi:
            raise Impossible(f"LOI {loi.bit_length() + 1} is not held; take it first")

    def configure(self):
        since = len(self.inbox)
        self.send(40000, self.configuration_request())
        if not self.wait(lambda m: m.id == 41005, CONFIG_S, since):
            raise Impossible("the configuration phase did not end")
        self.configured = True

    def configuration_request(self):
        return {"VSM ID": self.vsm_id, "Data Link ID": 0, "Request Type": 3, "Requested Message": 0, "Requested Field": 0, "Station Number 1-16": 0,
                "Sensor Select": 0}

    def command(self, id, fields, loi=LOI_4):
        """Sends with the acknowledgement bit; the same bytes again where none comes. The last acknowledgement, or None."""
        self.must_hold(loi)
        since, last = len(self.inbox), None
        wire, stamp = self.make_command(id, fields)
        for attempt in range(ATTEMPTS):
            self.transmit(wire if attempt == 0 else self.again(wire, id, fields))
            answer = self.wait(lambda m: m.id == 17000 and m.fields.get("Original Message Type") == id, ACK_S, since)
            if answer:
                last = self.wait(lambda m: m.id == 17000 and m.fields.get("Original Message Type") == id and m.fields.get("Acknowledgement Type") != 1,
                                 ANSWER_S, since) or answer
                return last.fields.get("Acknowledgement Type")
        self.display.unconfirmed.append(id)
        return None

    def make_command(self, id, fields):
        wire = self.encode(id, fields, ack=True)
        return wire, self.last_stamp

    def again(self, wire, _id, _fields):
        return wire

    def upload(self, points, mission="PLAN"):
        """Loads a route of (latitude, longitude in rad, altitude in m, seconds of loiter)."""
        self.must_hold(LOI_4)
        since = len(self.inbox)
        self.display.mission = "sending"
        messages = self.route(points)
        for id, fields in messages:
            self.transmit(self.encode(id, fields))
            self.pump(0.02)
        self.load(mission, since)

    def route(self, points):
        """The messages of a route, the waypoints numbered from 1."""
        messages = [(13001, {"Initial Waypoint Number": 1, "Route ID": "ROUTE", "Route Type": 2})]
        for number, (lat, lon, altitude, loiter) in enumerate(points, 1):
            following = number + 1 if number < len(points) else 0
            messages.append((13002, self.waypoint(number, lat, lon, altitude, following, bool(loiter))))
            if loiter:
                messages.append((13003, {"Waypoint Number": number, "Waypoint Loiter Type": 1, "Loiter Radius": 40, "Loiter Direction": 1,
                                         "Loiter Duration": loiter, "Loiter Duration Units": 0}))
        return messages

    def waypoint(self, number, lat, lon, altitude, following, loiter):
        return {"Waypoint Number": number, "Waypoint to Latitude or Relative Y": units.to_bam(lat, 32),
                "Waypoint to Longitude or Relative X": self.longitude(lon), "Location Type": 0, "Waypoint to Altitude": round(altitude / 0.02),
                "Waypoint Altitude Type": 1, "Altitude Change Behaviour": 0, "Waypoint to Speed": 20, "Waypoint Speed Type": 2,
                "Next Waypoint": following, "Turn Type": 0, "Optional Messages for Waypoint": 1 if loiter else 0, "Waypoint Type": 0, "Limit Type": 0,
                "Loop Limit": 0, "Arrival Time": 0, "Activity ID": 0}

    def longitude(self, lon):
        return units.to_bam(lon, 32)

    def load(self, mission, since):
        self.send(13000, {"Mission ID": mission, "Mission Plan Mode": 2, "Waypoint Number": 0, "Route ID": ""})
        if not self.wait(lambda m: m.id == 14000 and m.fields.get("Status") in (1, 2), LOAD_S, since):
            self.display.mission = "not loaded: no answer"
        if self.display.mission != "loaded":
            raise Impossible(f"the mission is {self.display.mission}")

    def fly_mode(self, mode, **fields):
        if mode not in self.display.offered_modes():
            raise Impossible(f"mode {mode} is not available")
        return self.command(2016, {MODE: mode, **fields}, LOI_5 if mode in NEEDS_LOI_5 else LOI_4)

    def set_loiter(self, radius_m):
        raw = round(radius_m / units.RADIUS_STEP_M)
        if not self.display.within(2017, 3, raw):
            raise Impossible(f"a loiter radius of {radius_m:g} m is outside of what the vehicle declares")
        return self.command(2017, {"Loiter Type": 1, "Loiter Radius": raw, "Loiter Direction": 1})

    def answer_handover(self, consent):
        """What the operator decided about a handover request."""
        if self.display.handover is None:
            raise Impossible("nobody has asked for a handover")
        self.send(HANDOVER_MESSAGE, {"VSM ID": self.vsm_id, "Requested/Handover LOI": self.display.loi & 12 if consent else 0,
                                     "Requesting CUCS ID": signed(self.display.handover)})
        self.display.handover = None

    def ahead(self, north, east):
        """A place in metres from where the vehicle is shown."""
        if self.display.position is None:
            raise Impossible("the vehicle's position is not known")
        return units.moved(self.display.position, north, east)
