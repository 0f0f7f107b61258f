"""The content of every status message of one vehicle, by its id: functions of the vehicle and of who asks."""
from . import aircraft as flight
from .authority import bits
from .configuration import AIRBORNE_STATE
from .units import ENERGY_STEP, SPEED_STEP, TURN_RATE_STEP, clamp, distance, fine, to_bam
from .wire import signed

PUSHED = (3001, 3002, 4000, 4001)
NO_NUMBER = 65535
HANDLED_SUBSYSTEMS = {0: "engines", 2: "electrical", 3: "data link", 4: "battery", 5: "navigation", 6: "payload", 9: "VSM"}
GRAVITY = 9.81


def authorisation(v, cucs, _mask):
    """2"""
    a = v.authority
    granted, request = v.granted_field(cucs), v.last_request.get(cucs, {})
    return [{"VSM ID": v.vsm_id_field, "Data Link ID": 0, "Access Authorized": 2 if a.authorised(cucs) and a.may_override(cucs) else 1,
             "Access Granted": 1 if granted & ~1 else 0, "LOI Authorized": a.authorised(cucs), "LOI Granted": granted, "Flight Modes Granted": 0,
             "Controlled Station 1-16": a.stations_of(cucs) & 0xFFFF, "Component Number": 0, "Sub-Component Number": 0,
             "Payload Type": 3 if v.payloads.stations else 0, "Access Requested": request.get("Requested/Handover Access", 0),
             "Vehicle Type": v.type, "Vehicle Subtype": v.subtype, "CUCS Type": request.get("CUCS Type", 0),
             "CUCS Subtype": request.get("CUCS Subtype", 0), "Presence Vector Support": 1, "Controlled Station 17-32": a.stations_of(cucs) >> 16}]


def identification(v, _cucs, _mask):
    """3"""
    return [{"VSM ID": v.vsm_id_field, "Vehicle ID Update": signed(v.id), "Vehicle Type": v.type, "Vehicle Subtype": v.subtype, "Owning ID": v.real_id >> 24,
             "Tail Number": v.tail_number if v.id == v.real_id else "0", "Mission ID": v.mission.aboard.mission, "ATC Call Sign": v.call_sign,
             "Configuration Checksum": 0}]


def vehicle_configuration(v, _cucs, _mask):
    """3000"""
    return [{"Configuration ID": 1, "Propulsion Fuel Capacity": 0.0, "Propulsion Battery Capacity": 1.8e6, "Maximum Indicated Airspeed": 25,
             "Optimum Cruise Indicated Airspeed": 12, "Optimum Endurance Indicated Airspeed": 10, "Maximum Load Factor": 20, "Gross Weight": 4.5,
             "X_CG": 0.0, "Number of Engines": len(v.aircraft.engines), "Fuel Density": 0}]


def mode(v, _cucs, _mask):
    """3001"""
    return [{"Select Flight Path Control Mode": v.steering.reported_mode()}]


def states(v, _cucs, _mask):
    """3002"""
    c, a = v.steering.commanded, v.aircraft
    same = ("Commanded Altitude", "Altitude Type", "Commanded Heading", "Commanded Course", "Commanded Turn Rate", "Commanded Roll Rate",
            "Commanded Speed", "Speed Type")
    last = ("Commanded Roll", "Altitude Command Type", "Heading Command Type")
    return [{**{name: c[name] for name in same}, "Power Level": 50 if a.airborne else 0, "Bingo Energy": round(20 / ENERGY_STEP),
             "Current Propulsion Energy Level": round(a.battery / ENERGY_STEP),
             "Current Propulsion Energy Usage Rate": round(100 / flight.ENDURANCE_S / 0.0002) if a.airborne else 0,
             **{name: c[name] for name in last}, "UA State": AIRBORNE_STATE if a.airborne else 3, "Thrust Direction": 0, "Thrust": 0,
             "Loiter & Waypoint Validity": 3, "Commanded Loiter Position Latitude": c["Loiter Position Latitude"],
             "Commanded Loiter Position Longitude": c["Loiter Position Longitude"],
             "Altitude Change Behaviour": c["Loiter Altitude Change Behaviour"], "Commanded Waypoint Number": c["Commanded Waypoint Number"]}]


def loiter(v, _cucs, _mask):
    """3004"""
    c = v.steering.commanded
    # The mode preference is of Edition 2.5 alone.
    loiter = {name: value for name, value in v.steering.loiter.items() if name != "Mode Preference" or v.options.edition == "2.5"}
    return [{**loiter, "Loiter Altitude": v.reported_altitude(v.aircraft.target_altitude), "Altitude Type": v.altitude_type(),
             "Loiter Speed": c["Commanded Speed"], "Speed Type": c["Speed Type"]}]


def termination(v, _cucs, _mask):
    """3005"""
    t = v.steering.termination
    return [{"Reported Flight Termination State": t.state, "Reported Flight Termination Mode": t.mode}]


def lights(v, _cucs, _mask):
    """3006"""
    return [{"Navigation Lights State": v.aircraft.lights}]


def engines(v, _cucs, _mask):
    """3007, one for each engine"""
    reports = []
    for number, engine in enumerate(v.aircraft.engines, 1):
        running = engine.status == 2
        fields = {"Engine Number": number, "Engine Status": engine.status, "Reported Engine Command": engine.command,
                  "Engine Power Setting": round(50 / 0.0017) if running else 0, "Engine Speed 1": 1200 if running else 0,
                  "Engine Temperature 1": 640 if running else 580, "Fire Detection Sensor Status": 4}
        zero = ("Reverse Thrust Power Status", "Reported Reverse Thrust", "Ignition Switch Power Status", "Ignition Switch Activation", "Engine Speed 1 Type",
                "Engine Speed 2 Type", "Engine Speed 2", "Engine Speed 3 Type", "Engine Speed 3", "Propeller Pitch Angle",
                "Output Power (Shaft Torque) Status", "Engine Temperature 1 Type", "Engine Temperature 2 Type", "Engine Temperature 2",
                "Engine Temperature 3 Type", "Engine Temperature 3", "Engine Temperature 4 Type", "Engine Temperature 4", "Engine Pressure 1 Type",
                "Engine Pressure 1", "Engine Pressure 1 Status", "Engine Pressure 2 Type", "Engine Pressure 2", "Engine Pressure 2 Status",
                "Engine Energy Flow", "Engine Body Temperature Status", "Exhaust Gas Temperature Status", "Coolant Temperature Status",
                "Lubricant Temperature Status")
        reports.append(dict.fromkeys(zero, 0) | fields)
    return reports


def air_and_ground(v, _cucs, _mask):
    """3009"""
    a = v.aircraft
    air = a.airspeed() if a.airborne else 0.0
    sea = v.altitude_field(a.altitude)
    return [{"Angle of Attack": 0, "Angle of Sideslip": 0, "True Airspeed": fine(air), "Indicated Airspeed": fine(air), "Outside Air Temp": 576,
             "U_Wind": fine(a.wind[0]), "V_Wind": fine(a.wind[1]), "Altimeter Setting": 10132, "Barometric Altitude": sea,
             "Barometric Altitude Rate": fine(a.up), "Pressure Altitude": sea, "AGL Altitude": v.altitude_field(a.height),
             "WGS-84 Altitude": v.altitude_field(a.altitude + a.geoid), "U_Ground": fine(a.north), "V_Ground": fine(a.east)}]


def body(v, _cucs, _mask):
    """3010"""
    a = v.aircraft
    return [{"X_Body_Accel": 0, "Y_Body_Accel": 0, "Z_Body_Accel": round(-GRAVITY / 0.005),
             **{f"{name}_Rate": int(clamp(rate / TURN_RATE_STEP, -32768, 32767))
                for name, rate in (("Roll", a.roll_rate), ("Pitch", a.pitch_rate), ("Yaw", a.turn_rate))}}]


def inertial(v, _cucs, _mask):
    """4000. Without a fix there is no position and no altitude, rather than zeros."""
    a = v.aircraft
    position = {"Latitude": to_bam(a.place[0], 32), "Longitude": to_bam(a.place[1], 32)} if a.fix else v.unknown_position()
    altitude = {"Altitude": v.reported_altitude(a.altitude), "Altitude Type": v.altitude_type()} if a.fix else {}
    return [{**position, **altitude, "U_Speed": fine(a.north), "V_Speed": fine(a.east), "W_Speed": v.down_speed(a.up),
             "U_Accel": coarse(a.acceleration[0]), "V_Accel": coarse(a.acceleration[1]), "W_Accel": coarse(-a.acceleration[2]),
             "Roll": to_bam(a.roll, 16), "Pitch": to_bam(a.pitch, 16), "Heading": to_bam(v.reported_heading(a.heading), 16),
             "Roll Rate": coarse(a.roll_rate), "Pitch Rate": coarse(a.pitch_rate), "Turn Rate": coarse(a.turn_rate),
             "Magnetic Variation": to_bam(a.variation, 16)}]


def coarse(value):
    """An acceleration or a rate of 4000, in steps of 0.005."""
    return int(clamp(round(value / 0.005), -32768, 32767))


def waypoints(v, _cucs, _mask):
    """4001. A number of 0 says that its group is not valid; 65535 as To is a place without a number."""
    a, s = v.aircraft, v.steering
    now, speed = v.sampled, max(a.ground_speed, 0.5)
    ahead = upcoming(a)
    fields = {"Altitude Type": v.altitude_type(), "Speed Type": 2, "Loiter Configuration Report Validity for To Waypoint": 0}
    fields |= group(v, "From", None, 0, 0) | group(v, "To", None, 0, 0) | group(v, "Next", None, 0, 0)
    if a.mode in flight.ON_ROUTE:
        # A corner that was cut costs nothing, so the speed of the leg stands for a vehicle that has just started.
        speed = speed if a.ground_speed > 1 else ahead[0].speed or a.speed
        way = distance(a.place, ahead[0].place)
        eta = now + int(1000 * way / speed)
        departed, at = a.departed
        if departed.number:
            fields |= group(v, "From", departed, now - int(1000 * (a.time - at) / v.options.speed), departed.speed)
        fields |= group(v, "To", ahead[0], eta, ahead[0].speed or a.speed)
        if len(ahead) > 1:
            way = distance(ahead[0].place, ahead[1].place)
            fields |= group(v, "Next", ahead[1], eta + int(1000 * way / (ahead[1].speed or a.speed)), ahead[1].speed or a.speed)
        fields["Loiter Configuration Report Validity for To Waypoint"] = 1 if ahead[0].loiter else 0
    elif a.mode == flight.LOITER:
        place = flight.Point(NO_NUMBER, a.loiter.place, a.target_altitude)
        eta = now + int(1000 * max(0.0, distance(a.place, a.loiter.place) - a.loiter.radius) / speed)
        fields |= group(v, "To", place, eta, s.commanded["Commanded Speed"] * SPEED_STEP)
        fields["Loiter Configuration Report Validity for To Waypoint"] = 1
    return [fields]


def upcoming(a):
    """The waypoints ahead, without the points of curves between them."""
    return [p for p in a.route[a.leg:] if p.number] if a.mode in flight.ON_ROUTE else []


def group(v, which, point, time, speed):
    number = point.number if point else 0
    place = point.place if point else (0.0, 0.0)
    fields = {f"{which} Waypoint - Latitude": to_bam(place[0], 32), f"{which} Waypoint - Longitude": to_bam(place[1], 32),
              f"{which} Waypoint Altitude": v.reported_altitude(point.altitude) if point else 0, f"{which} Waypoint Time": time,
              f"{which} Waypoint Number": number}
    if which != "From":
        fields[f"{which} Waypoint Speed"] = round((speed or 0) / SPEED_STEP)
    return fields


def battery(v, _cucs, _mask):
    """12101"""
    return [{"Bank Selected": 1, "Connection Status": 1, "Bus Voltage": 2220, "Battery Current": 100 if v.aircraft.airborne else 5,
             "Battery Charge Remaining": round(v.aircraft.battery / ENERGY_STEP), "Battery Temperature": 590}]


def satellites(v, _cucs, _mask):
    """18500"""
    return [{"Number of Satellites": 14 if v.aircraft.fix else 0, "GPS Mode": 3 if v.aircraft.fix else 0, "GPS Status": 1 if v.aircraft.fix else 0,
             "PDOP": 1, "HDOP": 1, "VDOP": 1, "Reserved": 0, "GPS Time": v.sampled}]


def subsystems(v, mask):
    """16001, one for each subsystem that was asked for and exists"""
    reports = []
    for bit in bits(mask):
        id = bit.bit_length() - 1
        if id in HANDLED_SUBSYSTEMS:
            state = 5 if id == 3 and v.link_lost else 2 if id == 5 and not v.aircraft.fix else 1
            reports.append({"Subsystem ID": id, "Subsystem State": state, "Subsystem State Report Reference": -1, "Report Text Type": 0,
                            "Report Text Reference": HANDLED_SUBSYSTEMS[id], "Controlled Station 1-16": 0, "Controlled Station 17-32": 0,
                            "Component Number": 0, "Sub-Component Number": 0})
    return reports


def data_link(v, cucs, _mask):
    """28001"""
    holder = v.link_holder
    return [{"VSM/Vehicle ID": v.vsm_id_field, "Access Authorized": 1, "Access Granted": 1 if holder == cucs else 0, "Access Requested": 0,
             "Terminal Type": 0, "Data Link Type": 8, "Data Link Subtype": 1, "Data Link Name": "SIMULATED", "Antenna Type": 0, "Pedestal Index": 0,
             "Vehicle Type": v.type, "Vehicle Subtype": v.subtype, "Data Link Control Availability": 0 if holder is None else 2 if holder == cucs else 1}]


def data_link_status(v, _cucs, _mask):
    """32005, one for each terminal"""
    return [{"Addressed Terminal": terminal, "Data Link State": 1 if v.link_lost else 2, "Antenna State": 0, "Reported Channel": 1,
             "Reported Primary Hop Pattern": 0, "Reported Forward Link Carrier Frequency": 2.4e9, "Reported Return Link Carrier Frequency": 2.4e9,
             "Downlink Status": 0 if v.link_lost else 100, "Communication Security State": 0, "Link Channel Priority State": 0} for terminal in (0, 1)]


def handover(v, _cucs, _mask):
    """35000"""
    h = v.authority.handover
    return [{"CUCS ID (relinquishing control)": signed(h.giving), "CUCS ID (acquiring control)": signed(h.taking), "Status": h.status,
             "Air Data Link ID": 0}]


def services(v, _cucs, _mask):
    """43000"""
    return [{"VSM Home Web Page URL": "", "FTP URL": ""}]


REPORTS = {2: authorisation, 3: identification, 3000: vehicle_configuration, 3001: mode, 3002: states, 3004: loiter, 3005: termination, 3006: lights,
           3007: engines, 3009: air_and_ground, 3010: body, 4000: inertial, 4001: waypoints, 12101: battery, 18500: satellites,
           21000: lambda v, cucs, mask: v.payloads.configuration(mask), 21100: lambda v, cucs, mask: v.payloads.camera(mask),
           21101: lambda v, cucs, mask: v.payloads.states(mask), 28001: data_link, 32005: data_link_status, 35000: handover, 43000: services}
# What only the vehicle knows, and nobody while its link is down.
OF_VEHICLE = {3000, 3001, 3002, 3005, 3006, 3007, 3009, 3010, 4000, 4001, 12101, 18500, 21101}
