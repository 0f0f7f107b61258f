"""The operator's page as a ground station: a route is drawn, sent, flown and seen; what is not allowed leads to nothing and is named.

    page_commands.py http://127.0.0.1:8586/ ID KEY_FILE --low-battery PID --second COMMAND [--shots DIR]

PID is the simulated vehicle's process, which reports a low battery by a signal; COMMAND is a second ground station that asks for control.
"""

import argparse
import http.server
import json
import math
import os
import pathlib
import re
import shlex
import signal
import subprocess
import sys
import threading
import time

from jsonschema import Draft202012Validator

from browser import ANSWER_WITHIN_MS, LOOKS, Browser
from checks import Checks

SCHEMA = json.loads((pathlib.Path(__file__).parents[2] / "docs/reference/websocket.schema.json").read_text())
# Of the same message so many frames are held against it.
OF_EACH = 20
FLOOD_S = 20
ALERTS_A_MINUTE = 1000
MAX_COMMANDS_SHOWN = 30
RADIUS_M = 6_371_008.8
# A multicopter cuts the corners of a route by its acceptance radius.
BESIDE_M = 12
# Drawn on the map, pixels beside the vehicle.
DRAWN = [(90, -60), (150, 40), (40, 90)]


# The connection of a page at hand: `spy.take(body)` takes a frame as of the VSM, by `spy.socket` the page sends, `spy.opened` counts.
SPY = """async () => {
    const { ControlSocket } = await import(new URL('page/socket.js', location.href).href);
    const open = ControlSocket.open;
    window.spy = { opened: 0 };
    ControlSocket.open = async (id, key, take, closed) => {
        const opened = await open.call(ControlSocket, id, key, take, closed);
        Object.assign(window.spy, { take, socket: opened[0], opened: window.spy.opened + 1 });
        return opened;
    };
}"""
OTHER_STATION = "1b:00:00:a0"
OTHER_VEHICLE = "1b:00:01:77"


class Frames:
    """What crosses the WebSocket of a page, held against its JSON Schema."""

    def __init__(self, page):
        part = lambda name: Draft202012Validator({"$defs": SCHEMA["$defs"], "$ref": f"#/$defs/{name}"})
        self._of_client, self._of_vsm, self._challenge = part("from_client"), part("from_vsm"), part("challenge")
        self._whole = Draft202012Validator(SCHEMA)
        self._seen = {}
        self.faults = []
        page.on("websocket", self._watch)

    def _watch(self, socket):
        socket.on("framesent", lambda text: self._hold("sent", text, self._of_client))
        socket.on("framereceived", lambda text: self._hold("received", text, self._of_vsm))

    def _hold(self, way, text, schema):
        if text.startswith("{"):
            schema, body = self._challenge, json.loads(text)
        else:
            # Without the MAC.
            body = json.loads(text[65:])
        kind = next(key for key in body if key != "n")
        of = (way, kind, body[kind].get("id"))
        self._seen[of] = self._seen.get(of, 0) + 1
        if self._seen[of] <= OF_EACH:
            self.faults += [f"{way}: {fault.message}: {body}" for one in (schema, self._whole) for fault in one.iter_errors(body)]

    def kinds(self):
        return {f"{way} {kind}" for way, kind, _ in self._seen}


def state(page):
    return page.evaluate("fetch('status.json').then((answer) => answer.json()).then((all) => all.vehicles[0])")


def until_state(page, what, holds, within_s):
    for _ in range(int(within_s / 0.2)):
        if holds(state(page)):
            return
        page.wait_for_timeout(200)
    raise AssertionError(f"not within {within_s} s: {what}: {state(page)}; commands: {page.locator('#commands').inner_text()}")


def metres(a, b):
    north = math.radians(b[0] - a[0])
    east = math.radians(b[1] - a[1]) * math.cos(math.radians(a[0]))
    return RADIUS_M * math.hypot(north, east)


def beside(at, line):
    """Metres from a place to a line of places."""
    scale = math.cos(math.radians(at[0]))
    best = math.inf
    for a, b in zip(line, line[1:]):
        d = (b[0] - a[0], (b[1] - a[1]) * scale)
        p = (at[0] - a[0], (at[1] - a[1]) * scale)
        square = d[0] ** 2 + d[1] ** 2
        part = min(1, max(0, (d[0] * p[0] + d[1] * p[1]) / square)) if square else 0
        best = min(best, metres(at, (a[0] + part * d[0], a[1] + part * d[1] / scale)))
    return best


def connect(opened, station, key):
    page = opened.page
    opened.until("!document.getElementById('control').hidden")
    page.locator("#station-id").fill(station)
    page.locator("#key").fill(key)
    page.locator("#connect").click()


def newest(opened, text, within_s=20):
    """Waits until the newest command has this in what became of it."""
    opened.until(f"document.querySelector('#commands li')?.textContent.includes({text!r})", within_s)


def confirm(page, button, word):
    page.locator(button).click()
    yes = page.locator("#confirm-yes")
    assert yes.inner_text() == word, yes.inner_text()
    yes.click()


def kept_out(checks, browser, url, station, key):
    checks.step("who is kept out")
    opened = browser.open(url)
    connect(opened, station, "00" * 32)
    opened.until("document.getElementById('control-state').textContent.includes('not authenticated')")
    said = opened.text("#control-state")
    checks.check("a wrong key is named", "the key is not the one of this id" in said, said)
    connect(opened, station, "a key")
    opened.until("document.getElementById('control-state').textContent.includes('64 hexadecimal')")
    checks.check("what is no key is named", True)
    opened.close()
    # With the right key: nothing else keeps it from connecting.
    opened = browser.open(f"{url}#{station}={key}")
    opened.until("document.getElementById('control-state').textContent.includes('press Connect')")
    opened.page.wait_for_timeout(1_000)
    signed_in = opened.page.locator("#station").is_visible()
    checks.check("a link with a key connects nobody by itself", not signed_in and "#" not in opened.page.url, opened.page.url)
    opened.close()

    class Page(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<!doctype html><title>another page</title>")

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Page)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    other = browser.open(f"http://127.0.0.1:{server.server_port}/")
    # It is the bridge that has to refuse it, not the guard of this test.
    other.context.unroute_all()
    ws = url.replace("http", "ws", 1) + "control"
    seen = other.page.evaluate(
        """(url) => new Promise((done) => {
            const socket = new WebSocket(url);
            socket.onopen = () => done('open');
            socket.onmessage = () => done('a frame');
            socket.onerror = () => done('refused');
        })""",
        ws,
    )
    checks.check("a page of another origin opens no WebSocket", seen == "refused", seen)
    other.close()
    server.shutdown()
    opened = browser.open(url)
    for why in ["wrong key", "another origin"]:
        opened.until(f"document.getElementById('events').textContent.includes('web client refused: {why}, from 127.0.0.1')")
    opened.page.locator("#only-refused").check()
    shown = opened.text("#events")
    checks.check("each is among the events, with its time, reason and address", re.search(r"\d UTC 1b:00:00:b0: web client refused: wrong key", shown), shown)
    opened.close()


def drop(page, name, text):
    page.evaluate(
        """([name, text]) => {
            const all = new DataTransfer();
            all.items.add(new File([text], name));
            document.getElementById('map').dispatchEvent(new DragEvent('drop', { bubbles: true, cancelable: true, dataTransfer: all }));
        }""",
        [name, text],
    )


def line_of(page):
    """A line on the ground beside the vehicle, with an area of a fence, which no route has."""
    north, east, _ = state(page)["position"]
    shapes = [
        ({}, {"type": "LineString", "coordinates": [[east, north + 0.001], [east + 0.001, north + 0.001]]}),
        ({"keep": "in", "radius_m": 500}, {"type": "Point", "coordinates": [east, north]}),
    ]
    features = [{"type": "Feature", "properties": properties, "geometry": geometry} for properties, geometry in shapes]
    return json.dumps({"type": "FeatureCollection", "features": features})


def a_file_is_dropped(checks, opened):
    checks.step("a file is dropped on the map")
    page = opened.page
    drop(page, "dropped.geojson", line_of(page))
    newest(opened, "dropped.geojson")
    newest(opened, "accepted")
    row = page.locator("#commands li").first.inner_text()
    checks.check("what of it was not sent is named beside the result", "without geofence" in row, row)
    opened.until("document.querySelectorAll('.waypoint').length === 2")
    route = page.evaluate("fetch('map.json').then((answer) => answer.json()).then((all) => all[0].route)")
    above = [round(one["amsl_m"] - 488) for one in route["waypoints"]]
    checks.check("the vehicle has it, at the height that is typed for files without altitudes", above == [25, 25], above)
    drop(page, "route.txt", "no route")
    newest(opened, "not used")
    checks.check("what is no route is named", True)
    for name, text in [("film.kml", "x" * 300_000), ("quoted.kml", '"' * 200_000)]:
        drop(page, name, text)
        opened.until(f"document.getElementById('control-state').textContent.startsWith('the route is not sent: {name} takes ')")
    page.wait_for_timeout(500)
    checks.check("a file that no frame holds is not sent, and the connection stays", page.locator("#station").is_visible())


def an_alert_is_acknowledged(checks, opened, station, vehicle_process):
    checks.step("an alert is acknowledged")
    os.kill(vehicle_process, signal.SIGUSR1)
    opened.until("document.querySelector('#alerts button')")
    opened.page.locator("#alerts button").first.click()
    opened.until(f"document.getElementById('alerts').textContent.includes('acknowledged by {station}')")
    checks.check("who has is shown", True)
    os.kill(vehicle_process, signal.SIGUSR2)


def control_is_handed_over(checks, opened, second):
    checks.step("another ground station asks for control")
    page = opened.page
    other = subprocess.Popen(shlex.split(second), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        opened.until("!document.getElementById('asked').hidden")
        asked = opened.text("#asked-text")
        checks.check("who asks, and for what, is shown", "1b:00:00:a0 asks for" in asked, asked)
        page.locator("#hand-over").click()
        said, _ = other.communicate(timeout=30)
        checks.check("it has control", other.returncode == 0, said)
    finally:
        other.kill()
    opened.until("document.getElementById('holders').textContent.includes('1b:00:00:a0 (controls)')")
    checks.check("the page shows who controls now", "1b:00:00:a0 (controls)" in opened.text("#holders"), opened.text("#holders"))


def control_is_asked_for(checks, opened, second):
    """Of the ground station that has it, which consents."""
    checks.step("this ground station asks for control")
    page = opened.page
    opened.until("document.getElementById('next').textContent.includes('ask for control')")
    other = subprocess.Popen(shlex.split(second.removesuffix(" ask") + " consent"), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        page.locator("#ask").click()
        said, _ = other.communicate(timeout=30)
        checks.check("the other one consents", other.returncode == 0, said)
    finally:
        other.kill()
    newest(opened, "accepted")
    opened.until("document.getElementById('station-rights').textContent.includes('control')")
    checks.check("it has control", "control" in opened.text("#station-rights"), opened.text("#station-rights"))


def looks_well(checks, browser, url, station, key):
    for name, options in LOOKS.items():
        checks.step(f"accessible with control: {name}")
        opened = browser.open(url, **options)
        connect(opened, station, key)
        opened.until("!document.getElementById('station').hidden")
        found = opened.violations()
        checks.check("axe-core finds nothing", not found, found)
        checks.check("nothing is wider than the window", opened.wider_by() <= 0, opened.wider_by())
        opened.close()


def pretends(page):
    """What is put in here the bridge reports of its vehicle, over what it does report."""
    over = {}

    def status(route):
        body = route.fetch().json()
        body["vehicles"][0].update(over)
        route.fulfill(json=body)

    page.route("**/status.json*", status)
    return over


def take(opened):
    opened.page.locator("#take").click()
    opened.until("document.getElementById('station-rights').textContent.startsWith('holds LOI')")


def release(opened):
    opened.page.locator("#release").click()
    opened.until("document.getElementById('station-rights').textContent.startsWith('holds no level')")


def says(opened, text):
    opened.until(f"document.getElementById('control-state').textContent.includes({text!r})")


def one_tool_at_a_time(checks, opened):
    checks.step("one map tool at a time")
    page = opened.page
    pressed = lambda: page.evaluate("['draw', 'loiter'].filter((id) => document.getElementById(id).getAttribute('aria-pressed') === 'true')")
    page.locator("#loiter").click()
    page.locator("#draw").click()
    checks.check("Draw takes the map from Loiter", pressed() == ["draw"], pressed())
    page.locator("#map").click(position={"x": 200, "y": 200})
    checks.check("a click is a point then", page.locator("#draft li").count() == 1 and not page.locator("#confirm").is_visible())
    page.keyboard.press("Escape")
    checks.check("Escape ends it", pressed() == [], pressed())
    page.locator("#loiter").click()
    page.locator("#loiter").click()
    checks.check("a second press ends Loiter", pressed() == [], pressed())
    page.locator("#draw-clear").click()


def no_number_sends_nothing(checks, opened):
    checks.step("what is no number")
    page = opened.page
    for field, button in [("#fly-from", "#fly"), ("#loiter-altitude", "#loiter-middle")]:
        page.locator(field).press_sequentially("1e")
        page.locator(button).click()
        said = opened.text("#control-state")
        checks.check(f"in {field} it sends nothing", "nothing is sent" in said and not page.locator("#confirm").is_visible(), said)
        page.locator(field).fill("")
    page.locator("#route-altitude").fill("25")
    for _ in range(2):
        page.locator("#draw-middle").click()
    page.locator("#draft input").first.press_sequentially("1e")
    page.locator("#send-drawn").click()
    said = opened.text("#control-state")
    checks.check("as the altitude of a point it is named", "the altitude of point 1 is no number" in said, said)
    page.locator("#draft input").first.fill("")


def a_request_and_a_reason(checks, opened, over, station):
    """By frames as of the VSM; what the page sends stays here."""
    checks.step("what belongs to what")
    page = opened.page
    over["handovers"] = [{"from": station, "to": OTHER_STATION, "rights": "LOI 4", "waits_for": "consent of the holder"}]
    vehicle = state(page)["id"]
    request = {"Requesting CUCS ID": OTHER_STATION, "Requested/Handover LOI": ["LOI 4"]}
    page.evaluate("(message) => spy.take({ message })", {"id": 4, "source": vehicle, "fields": request})
    opened.until("!document.getElementById('asked').hidden")
    over["handovers"] = []
    opened.until("document.getElementById('asked').hidden")
    checks.check("a request that has ended is offered no more", True)
    over.clear()

    page.evaluate(
        """() => {
            const { send } = Object.getPrototypeOf(spy.socket);
            spy.socket.send = (body) => {
                // Who sends no heartbeat loses control.
                if (body.message?.id === 16002) return send.call(spy.socket, body);
                spy.command = body.message;
                return 0;
            };
        }"""
    )
    confirm(page, "#hold", "Hold")
    opened.until("spy.command")
    page.evaluate(
        """([vehicle, other]) => {
            const take = (id, source, fields) => spy.take({ message: { id, source, fields } });
            const alert = (source, id, text, Priority, subsystem) =>
                take(16000, source, { 'Time Stamp': id, 'Alert (Warning) ID': id, Priority, 'Subsystem ID': subsystem, Text: text });
            const answer = (source, id, text) => alert(source, id, text, 'caution', 'VSM status');
            answer(other, 9001, 'a fault of another');
            alert(vehicle, 9004, 'a finding in its name', 'warning', 'VSM status');
            alert(vehicle, 9005, 'what it reports by itself', 'caution', 'navigation');
            answer(vehicle, 9002, 'a fault of its own');
            take(17000, vehicle, { 'Original Message Time Stamp': spy.command.fields['Time Stamp'], 'Acknowledgement Type': 'refused' });
            answer(other, 9003, 'another one of another');
        }""",
        [vehicle, OTHER_VEHICLE],
    )
    newest(opened, "REFUSED")
    row = page.locator("#commands li").first.inner_text()
    checks.check("the reason of a refusal is the vehicle's own", row.endswith("REFUSED: a fault of its own"), row)


def in_a_flood(checks, opened):
    """Alerts that come over the connection, beside more commands than are shown."""
    checks.step(f"{ALERTS_A_MINUTE} alerts a minute, in control")
    page = opened.page
    page.evaluate("(n) => { for (let i = 0; i < n; i += 1) document.getElementById('take').click(); }", MAX_COMMANDS_SHOWN + 5)
    page.evaluate(
        """([vehicle, every_ms]) => {
            spy.alerts = 0;
            spy.flood = setInterval(() => {
                spy.alerts += 1;
                const fields = { 'Time Stamp': spy.alerts, 'Alert (Warning) ID': 10_000 + spy.alerts, Priority: 'warning', Text: `fault ${spy.alerts} of a flood` };
                spy.take({ message: { id: 16000, source: vehicle, fields } });
            }, every_ms);
        }""",
        [state(page)["id"], 60_000 / ALERTS_A_MINUTE],
    )
    slowest, end = 0, time.monotonic() + FLOOD_S
    while time.monotonic() < end:
        slowest = max(slowest, opened.click_ms("#only-refused"))
        page.wait_for_timeout(100)
    page.evaluate("clearInterval(spy.flood); delete spy.socket.send")
    sent, shown = page.evaluate("spy.alerts"), page.locator("#commands li").count()
    checks.say(f"{sent} alerts, slowest click {slowest:.0f} ms")
    checks.check("they came", sent > ALERTS_A_MINUTE / 60 * FLOOD_S / 2, sent)
    checks.check(f"a click is answered within {ANSWER_WITHIN_MS} ms", slowest < ANSWER_WITHIN_MS, slowest)
    checks.check("the newest commands are shown", shown == MAX_COMMANDS_SHOWN, shown)


def leaving_is_asked(checks, opened, over):
    checks.step("left with a vehicle in flight")
    page = opened.page
    over["on_ground"] = False
    opened.until("document.getElementById('now').textContent.includes('in the air')")
    page.locator("#disconnect").click()
    asked = opened.text("#confirm-text")
    checks.check("Disconnect asks", "Nobody will control" in asked and page.locator("#confirm").is_visible(), asked)
    page.locator("#confirm-no").click()
    left = []

    def stay(dialog):
        left.append(dialog.type)
        dialog.dismiss()

    page.on("dialog", stay)
    page.evaluate("setTimeout(() => location.reload())")
    page.wait_for_timeout(1_000)
    page.remove_listener("dialog", stay)
    checks.check("so does a reload", left == ["beforeunload"] and page.locator("#station").is_visible(), left)
    kept = page.evaluate("!document.getElementById('panel').dispatchEvent(new DragEvent('drop', { bubbles: true, cancelable: true }))")
    checks.check("a file that is dropped beside the map does not take the page's place", kept)
    over.clear()


def the_connection_ends(checks, opened, over):
    checks.step("the connection ends while the page asks")
    page = opened.page
    # It stands, as it was reported last: nobody knows whether it still does.
    over.update(live=False, armed=False)
    opened.until("document.querySelector('#vehicle dd')?.textContent.startsWith('no data')")
    checks.check("nothing is advised by old data", "no data" in opened.text("#next"), opened.text("#next"))
    page.locator("#send-drawn").click()
    asked = opened.text("#confirm-text")
    checks.check("a route for a silent vehicle is asked first", "may be flying" in asked, asked)
    page.locator("#confirm-no").click()
    page.locator("#draw").click()
    checks.check("what was not sent stays drawn", page.locator("#draft li").count() == 2)
    page.locator("#send-drawn").click()
    page.evaluate("spy.socket.close()")
    opened.until("!document.getElementById('sign-in').hidden")
    page.locator("#confirm-yes").click()
    says(opened, "not sent: disconnected")
    over.clear()
    opened.until("document.querySelector('#vehicle dd')?.textContent === 'live'")
    page.locator("#connect").click()
    opened.until("!document.getElementById('station').hidden")
    checks.check("the same station connects again without its key", True)
    take(opened)
    release(opened)
    take(opened)
    checks.check("and commands", True)

    over["alerts"] = [{"id": 77, "priority": "caution", "text": "a fault", "acknowledged": []}]
    page.evaluate("(source) => spy.take({ message: { id: 16000, source, fields: { 'Time Stamp': 1, 'Alert (Warning) ID': 77 } } })", state(page)["id"])
    opened.until("document.querySelector('#alerts button')")
    page.locator("#loiter").click()
    page.evaluate(
        """() => new Promise((done) => {
            const button = document.querySelector('#alerts button');
            spy.socket.close();
            const wait = setInterval(() => {
                if (document.getElementById('sign-in').hidden) return;
                clearInterval(wait);
                button.click();
                done();
            }, 5);
        })"""
    )
    pressed = page.locator("#loiter").get_attribute("aria-pressed")
    checks.check("a map tool ends with the connection", pressed == "false", pressed)
    over.clear()


def it_breaks(checks, browser, url, station, key):
    """Between page and bridge: what neither end has wanted, and what the bridge has."""
    checks.step("the connection breaks")
    opened = browser.open(url)
    page = opened.page
    between = []

    def watch(socket):
        socket.connect_to_server()
        between.append(socket)

    page.route_web_socket("**/control", watch)
    page.reload()
    opened.until("document.querySelector('#vehicle dd')?.textContent === 'live'")
    connect(opened, station, key)
    opened.until("!document.getElementById('station').hidden")
    take(opened)
    # As of a bridge that stops; its successor answers.
    between[-1].close(code=1001)
    says(opened, "connecting again")
    says(opened, "connected again")
    checks.check("it is opened again, once, without a press", len(between) == 2 and page.locator("#station").is_visible(), len(between))
    opened.until("document.getElementById('station-rights').textContent.includes('control')")
    checks.check("control was kept", "control" in opened.text("#station-rights"), opened.text("#station-rights"))
    over, commands = pretends(page), page.locator("#commands li").count()
    # As of a bridge that took it for gone; and in that time its control has ended.
    between[-1].close(code=4007)
    says(opened, "no answer of this page for 15 s, or it read too slowly; connecting again")
    over.update(controller=None)
    says(opened, "control is lost, nobody controls it now; to have it again, press Take control")
    checks.check("so is one that was taken for gone", len(between) == 3 and page.locator("#station").is_visible(), len(between))
    page.wait_for_timeout(1_000)
    checks.check("it takes nothing by itself", page.locator("#commands li").count() == commands, opened.text("#commands"))
    over.clear()
    opened.until("document.getElementById('holders').textContent.includes('(controls)')")
    release(opened)
    # As of a bridge whose answer to it is lost.
    between[-1].on_close(lambda *_: None)
    page.locator("#disconnect").click()
    page.wait_for_timeout(500)
    between[-1].close(code=1001)
    says(opened, "press Connect")
    page.wait_for_timeout(2_500)
    checks.check("Disconnect stays one", page.locator("#sign-in").is_visible() and len(between) == 3, len(between))
    page.locator("#connect").click()
    opened.until("!document.getElementById('station').hidden")
    between[-1].close(code=4001)
    says(opened, "connected from elsewhere")
    page.wait_for_timeout(2_500)
    checks.check("what was ended on purpose is not opened again", page.locator("#sign-in").is_visible() and len(between) == 4, len(between))
    checks.check("the console is empty", not opened.complaints, opened.complaints)
    page.route("**/status.json*", lambda route: route.abort())
    opened.until("document.getElementById('connection').textContent.endsWith('what is shown is old (it cannot be reached)')")
    checks.check("a bridge that cannot be reached is named in words", True)
    opened.close()


def asks_and_ends(checks, browser, url, station, key):
    checks.step("two presses of Connect")
    opened = browser.open(url)
    page = opened.page
    opened.until("document.querySelector('#vehicle dd')?.textContent === 'live'")
    page.evaluate(SPY)
    page.locator("#station-id").fill(station)
    page.locator("#key").fill(key)
    page.evaluate("for (let n = 0; n < 2; n += 1) document.getElementById('sign-in').requestSubmit()")
    opened.until(f"document.getElementById('station-name').textContent === '{station}'")
    page.wait_for_timeout(1_000)
    checks.check("they open one connection", page.evaluate("spy.opened") == 1 and page.locator("#station").is_visible())
    take(opened)
    metrics = page.evaluate("fetch('metrics').then((answer) => answer.text())").splitlines()
    controls = 'vsm_vehicle_controller{vehicle="%s",cucs="%s"} 1' % (state(page)["id"], station)
    checks.check("/metrics names who controls", controls in metrics, metrics)
    over = pretends(page)
    one_tool_at_a_time(checks, opened)
    no_number_sends_nothing(checks, opened)
    a_request_and_a_reason(checks, opened, over, station)
    in_a_flood(checks, opened)
    leaving_is_asked(checks, opened, over)
    the_connection_ends(checks, opened, over)

    checks.step("a link with a key, where the page is open")
    page.evaluate(f"location.hash = '#{station}={key}'")
    says(opened, "filled in by the link")
    checks.check("it is filled in, and gone from the address", page.locator("#key").input_value() == key and "#" not in page.url, page.url)
    page.locator("#connect").click()
    opened.until("!document.getElementById('station').hidden")
    release(opened)
    page.locator("#disconnect").click()
    opened.until("!document.getElementById('sign-in').hidden")
    checks.check("the console is empty", not opened.complaints, opened.complaints)
    opened.close()


def flies(checks, browser, url, station, key, vehicle_process, second, shots):
    checks.step("connected")
    opened = browser.open(url)
    page = opened.page
    frames = Frames(page)
    opened.until("document.querySelector('#vehicle dd')?.textContent === 'live'")
    connect(opened, station, key)
    opened.until(f"document.getElementById('station-name').textContent === '{station}'")
    opened.until("document.getElementById('station-rights').textContent.startsWith('holds no level')")
    kept = page.evaluate("JSON.stringify([localStorage, sessionStorage, document.cookie, ...[...document.querySelectorAll('input')].map((one) => one.value)])")
    checks.check("the key is kept nowhere", key not in kept)
    page.locator("#launch-altitude").fill("20")
    confirm(page, "#launch", "Launch")
    newest(opened, "REFUSED")
    opened.until("document.querySelector('#commands li').textContent.match(/LOI/)")
    checks.check("without a level a launch is refused with its reason", "LOI" in page.locator("#commands li").first.inner_text(), opened.text("#commands"))
    opened.until("document.getElementById('control-state').textContent.includes(': REFUSED: it needs LOI')")
    named = state(page)
    said = opened.text("#control-state")
    checks.check("the line above begins with the vehicle that has refused", said.startswith(f"{named['tail_number'] or named['id']}: REFUSED"), said)
    seen = page.evaluate(
        """() => {
            const line = document.getElementById('control-state');
            const reason = document.createRange();
            reason.setStart(line.firstChild, 0);
            reason.setEnd(line.firstChild, line.textContent.lastIndexOf(' ('));
            return reason.getBoundingClientRect().bottom <= line.getBoundingClientRect().bottom;
        }"""
    )
    checks.check("the line above has all of its reason", seen, opened.text("#control-state"))
    # It is drawn twice a second.
    page.wait_for_timeout(600)
    checks.check("after a refusal nothing is waited for", opened.text("#next") == "Next: take control", opened.text("#next"))
    drawable = page.locator("#draw").get_attribute("class") or ""
    checks.check("a route may be drawn without control", "idle" not in drawable, drawable)
    page.locator("#launch-altitude").press("Enter")
    page.wait_for_timeout(300)
    checks.check("Enter in the field of the launch asks, and answers nothing", page.locator("#confirm").is_visible())
    page.locator("#confirm-no").click()
    take(opened)
    checks.check("control is taken", "control" in opened.text("#station-rights"), opened.text("#station-rights"))

    checks.step("a route is drawn")
    page.locator("#draw").click()
    box = page.locator(".aircraft").bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    for right, down in DRAWN[:2]:
        page.mouse.click(middle[0] + right, middle[1] + down)
        page.wait_for_timeout(350)
    page.locator("#send-drawn").click()
    checks.check("a point without an altitude is not sent", "point 1 has no altitude" in opened.text("#control-state"), opened.text("#control-state"))
    for field in page.locator("#draft input").all():
        field.fill("20")
        field.press("Tab")
    page.locator("#route-altitude").fill("25")
    page.wait_for_timeout(700)
    checks.check("once it is given, the line has the last result again", ": take: accepted" in opened.text("#control-state"), opened.text("#control-state"))
    page.mouse.click(middle[0] + DRAWN[2][0], middle[1] + DRAWN[2][1])
    page.locator("#draw").click()
    checks.check("three points are drawn", page.locator("#draft li").count() == 3)
    spare = page.evaluate(
        """() => {
            const box = (id) => document.getElementById(id).getBoundingClientRect();
            return innerHeight - box('top').bottom - (box('fly').bottom - box('control').top);
        }"""
    )
    checks.check("Take control and what flies them are in sight together", spare >= 0, spare)
    page.locator("#units").select_option("aviation")
    typed = page.locator("#draft input").first.input_value()
    checks.check("in feet it is the same altitude", abs(float(typed) - 65.6) < 0.1, typed)
    page.locator("#units").select_option("metric")
    page.locator("#send-drawn").click()
    newest(opened, "accepted")
    opened.until("document.querySelectorAll('.waypoint').length === 3")
    route = page.evaluate("fetch('map.json').then((answer) => answer.json()).then((all) => all[0].route)")
    above = [round(one["amsl_m"] - 488) for one in route["waypoints"]]
    checks.check("the vehicle has it, at its altitudes", above == [20, 20, 25], above)
    opened.until("document.getElementById('profile-text').textContent.startsWith('altitude above home')")
    checks.check("the profile has them as they were typed", "25.0 m" in page.locator("#profile").text_content(), page.locator("#profile").text_content())

    checks.step("it is flown")
    page.locator("#launch").click()
    page.locator("#confirm-no").click()
    page.wait_for_timeout(300)
    checks.check("what is not confirmed is not done", state(page)["armed"] is False)
    confirm(page, "#launch", "Launch")
    newest(opened, "accepted", 40)
    until_state(page, "it is in the air", lambda one: one["on_ground"] is False, 20)
    confirm(page, "#fly", "Fly")
    until_state(page, "it flies the route", lambda one: one["flies_to"] is not None, 20)
    line = [one["at"] for one in route["path"]]
    off, seen = [], set()
    for _ in range(400):
        now = state(page)
        if now["flies_to"]:
            seen.add(now["flies_to"])
            if now["flies_to"] > 1:
                off.append(beside(now["position"], line))
        elif seen:
            break
        page.wait_for_timeout(100)
    checks.check("all waypoints are flown to", seen == {1, 2, 3}, seen)
    checks.check(f"within {BESIDE_M} m of the route", off and max(off) < BESIDE_M, max(off, default=None))
    track = page.locator("path.track").get_attribute("d")
    checks.check("its track is drawn", track.count("L") >= 2, track)
    if shots:
        page.screenshot(path=f"{shots}/page-control.png")

    checks.step("it loiters at a click, and lands")
    page.locator("#loiter").click()
    page.mouse.click(middle[0] - 60, middle[1] - 60)
    page.locator("#confirm-yes").click()
    newest(opened, "accepted", 40)
    confirm(page, "#land", "Land")
    until_state(page, "it has landed", lambda one: one["on_ground"] is True and one["armed"] is False, 60)
    checks.check("it has landed", True)
    found = opened.violations()
    checks.check("axe-core finds nothing", not found, found)
    release(opened)
    take(opened)
    a_file_is_dropped(checks, opened)
    an_alert_is_acknowledged(checks, opened, station, vehicle_process)
    control_is_handed_over(checks, opened, second)
    control_is_asked_for(checks, opened, second)
    page.locator("#disconnect").click()
    opened.until("!document.getElementById('sign-in').hidden")
    checks.step("the frames and their JSON Schema")
    kinds = {"received challenge", "sent hello", "received welcome", "sent message", "received message", "sent route", "received route", "received error"}
    checks.check("every kind has crossed", frames.kinds() == kinds, frames.kinds())
    checks.check("each is as the schema has it", not frames.faults, frames.faults[:5])
    complaints = [one for one in opened.complaints if not re.search("favicon", one)]
    checks.check("the console is empty", not complaints, complaints)
    checks.check("no other host was asked", not opened.elsewhere, opened.elsewhere)
    opened.close()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("url")
    parser.add_argument("station")
    parser.add_argument("key_file", type=pathlib.Path)
    parser.add_argument("--low-battery", type=int, required=True)
    parser.add_argument("--second", required=True)
    parser.add_argument("--shots")
    arguments = parser.parse_args()
    key = arguments.key_file.read_text().strip()
    checks = Checks()
    with Browser() as browser:
        kept_out(checks, browser, arguments.url, arguments.station, key)
        looks_well(checks, browser, arguments.url, arguments.station, key)
        it_breaks(checks, browser, arguments.url, arguments.station, key)
        asks_and_ends(checks, browser, arguments.url, arguments.station, key)
        flies(checks, browser, arguments.url, arguments.station, key, arguments.low_battery, arguments.second, arguments.shots)
    checks.close()
    sys.exit(0 if checks.passed() else 1)


main()
