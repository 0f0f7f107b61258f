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

from browser import Browser
from checks import Checks

RADIUS_M = 6_371_008.8
# A multicopter cuts the corners of a route by its acceptance radius.
BESIDE_M = 12
# Drawn on the map, pixels beside the vehicle.
DRAWN = [(90, -60), (150, 40), (40, 90)]


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


def a_file_is_dropped(checks, opened):
    checks.step("a file is dropped on the map")
    page = opened.page
    north, east, _ = state(page)["position"]
    line = {"type": "LineString", "coordinates": [[east, north + 0.001], [east + 0.001, north + 0.001]]}
    page.evaluate(
        """(text) => {
            const all = new DataTransfer();
            all.items.add(new File([text], 'dropped.geojson'));
            document.getElementById('map').dispatchEvent(new DragEvent('drop', { bubbles: true, cancelable: true, dataTransfer: all }));
        }""",
        json.dumps(line),
    )
    newest(opened, "dropped.geojson")
    newest(opened, "accepted")
    opened.until("document.querySelectorAll('.waypoint').length === 2")
    route = page.evaluate("fetch('map.json').then((answer) => answer.json()).then((all) => all[0].route)")
    above = [round(one["amsl_m"] - 488) for one in route["waypoints"]]
    checks.check("the vehicle has it, at the height that is typed for files without altitudes", above == [25, 25], above)


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


def flies(checks, browser, url, station, key, vehicle_process, second, shots):
    checks.step("connected")
    opened = browser.open(url)
    page = opened.page
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
    page.locator("#take").click()
    opened.until("document.getElementById('station-rights').textContent.startsWith('holds LOI')")
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
    page.mouse.click(middle[0] + DRAWN[2][0], middle[1] + DRAWN[2][1])
    page.locator("#draw").click()
    checks.check("three points are drawn", page.locator("#draft li").count() == 3)
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
    page.locator("#release").click()
    opened.until("document.getElementById('station-rights').textContent.startsWith('holds no level')")
    page.locator("#take").click()
    opened.until("document.getElementById('station-rights').textContent.startsWith('holds LOI')")
    a_file_is_dropped(checks, opened)
    an_alert_is_acknowledged(checks, opened, station, vehicle_process)
    control_is_handed_over(checks, opened, second)
    page.locator("#disconnect").click()
    opened.until("!document.getElementById('sign-in').hidden")
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
        flies(checks, browser, arguments.url, arguments.station, key, arguments.low_battery, arguments.second, arguments.shots)
    checks.close()
    sys.exit(0 if checks.passed() else 1)


main()
