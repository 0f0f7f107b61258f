"""Thirteen lawful departures that the conformance suite must not call a fault."""
import socket
from dataclasses import replace as with_values

from .alerts import CAUTION, ELECTRICAL
from .change import each, replace, table
from .configuration import MODE_FIELD, Named
from .steering import NO_MODE
from .wire import HEADER

VARIANTS, variant = table()
GROUP = ("239.255.45.86", 45860)


@variant("L01", "#2 sent twice, half a second late")
def _(vsm):
    for vehicle in vsm.vehicles:
        waiting = []

        def send_report(cucs, id, mask=0, wanted=0, v=vehicle, waiting=waiting, lawful=vehicle.send_report):
            if id != 2:
                return lawful(cucs, id, mask, wanted)
            waiting.append((v.now() + 0.5, cucs))
            return True

        def advance(dt, v=vehicle, waiting=waiting, lawful=vehicle.advance, send=vehicle.send_report):
            lawful(dt)
            for due, cucs in [w for w in waiting if w[0] <= v.now()]:
                waiting.remove((due, cucs))
                send(cucs, 2)
                send(cucs, 2)
        vehicle.send_report, vehicle.advance = send_report, advance


@variant("L02", "strangers are answered by #2 with LOI Authorised 0")
def _(vsm):
    def known_source(source):
        return True

    def take(message, address, lawful=vsm.take):
        if message.source in vsm.access:
            lawful(message, address)
            return
        if message.id != 1 or message.source in (0, 0xFFFFFFFF, 0xFF000000) or message.source in {v.id for v in vsm.vehicles}:
            return
        for vehicle in vsm.addressed(message):
            fields = {"VSM ID": vehicle.vsm_id_field, "Data Link ID": 0, "Access Authorized": 0, "Access Granted": 0, "LOI Authorized": 0,
                      "LOI Granted": 0, "Vehicle Type": vehicle.type, "Vehicle Subtype": vehicle.subtype}
            vsm.socket.sendto(vsm.wire(message.source, vehicle.id, 2, fields), address)
    vsm.known_source, vsm.take = known_source, take


@variant("L03", "routes refused that the vehicle cannot fly: waypoints above 3000 m or faster than 20 m/s, as declared")
def _(vsm):
    highest = {"Waypoint to Altitude": 150_000, "Waypoint to Speed": 40}
    for vehicle in vsm.vehicles:
        vehicle.mission.highest_m, vehicle.mission.fastest_mps = 3000.0, 20.0
        own = vehicle.configuration
        own.ranges = tuple(with_values(r, high=highest[r.field]) if r.message == 13002 else r for r in own.ranges)


@variant("L04", "3002 without fields that the vehicle lacks; 4000 without acceleration")
def _(vsm):
    lacking = {3002: ("Power Level", "Thrust Direction", "Thrust", "Commanded Roll Rate"), 4000: ("U_Accel", "V_Accel", "W_Accel")}
    replace(vsm.codec, "encode", lambda old: lambda id, source, destination, fields, ack=False: old(
        id, source, destination, {n: v for n, v in fields.items() if n not in lacking.get(id, ())}, ack))


@variant("L05", "status at 10 Hz, by multicast and unicast both")
def _(vsm):
    vsm.push_hz = 10.0

    def open_both(lawful=vsm.open):
        lawful()
        vsm.socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        vsm.group = GROUP
    vsm.open = open_both


@variant("L06", "waypoint order in a download other than in the upload")
def _(vsm):
    each(vsm, "mission", "download_of", lambda old: lambda plan: list(old(plan))[::-1])


@variant("L07", "17000 of type 1 followed by type 2 for settings as well")
def _(vsm):
    def settle(message, vehicle, outcome, lawful=vsm.settle):
        if not outcome.reason and not outcome.shown:
            vsm.acknowledge(message, vehicle, 1)
        lawful(message, vehicle, outcome)
    vsm.settle = settle


@variant("L08", "no heartbeats, no #5, no curve messages, no payload")
def _(vsm):
    vsm.heartbeat_s = None
    for vehicle in vsm.vehicles:
        vehicle.payloads.stations = []
        vehicle.authority.stations = 0
        vehicle.send_granted = lambda cucs, loi: None
        replace(vehicle, "handles", lambda old: lambda id: old(id) and id not in (50001, 50002, 19001, 19100))


@variant("L09", "an owner code that the table lacks")
def _(vsm):
    vsm.options.vsm_id = 0x21 << 24 | vsm.options.vsm_id & 0xFFFFFF
    for vehicle in vsm.vehicles:
        vehicle.real_id = 0x21 << 24 | vehicle.real_id & 0xFFFFFF
        if vsm.options.link:
            vehicle.id = vehicle.real_id


@variant("L10", "a vehicle-specific mode described by 41002: on the ground the mode is 33")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.configuration.names += (Named(1, 3001, MODE_FIELD, 33, "STANDBY", "on the ground, ready"),)
    each(vsm, "steering", "reported_mode", lambda old: lambda: 33 if old() == NO_MODE else old())


@variant("L11", "an extra 16000, 44003 and private message every few seconds")
def _(vsm):
    for vehicle in vsm.vehicles:
        sent = [0.0]

        def advance(dt, v=vehicle, sent=sent, lawful=vehicle.advance):
            lawful(dt)
            if v.now() - sent[0] < 3:
                return
            sent[0] = v.now()
            v.alerts.raise_(f"extra {sent[0]}", CAUTION, ELECTRICAL, "cabin light left on", v.now(), 3)
            for cucs in v.authority.watching():
                v.report(cucs, *v.configuration.value(2007, "Set Lights", 0, 0))
                wire = HEADER.pack(0, 8, v.id, cucs, 60000, 32 << 8) + b"\x01" + bytes(7)
                vsm.transmit(cucs, wire)
        vehicle.advance = advance


@variant("L12", "no checksums on a clean link")
def _(vsm):
    vsm.codec.style = 0


@variant("L13", "3004 without what a circle lacks: length and bearing")
def _(vsm):
    lacking = ("Loiter Length", "Loiter Length Units", "Loiter Bearing")
    replace(vsm.codec, "encode", lambda old: lambda id, source, destination, fields, ack=False: old(
        id, source, destination, {n: v for n, v in fields.items() if id != 3004 or n not in lacking}, ack))
