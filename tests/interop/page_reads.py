"""The operator's page in a browser: it loads from the bridge alone, is quick, small, quiet and accessible, and stays usable in a flood.

    page_reads.py http://127.0.0.1:8586/ [--shots DIR]

With `--shots` it leaves pictures of the page there.
"""

import argparse
import gzip
import json
import sys
import time
from itertools import dropwhile
from urllib.parse import parse_qs, urlsplit

from browser import ANSWER_WITHIN_MS, LOOKS, Browser
from checks import Checks

MAX_GZIPPED = 500_000
FIRST_PAINT_MS = 1000
ALERTS_A_MINUTE = 1000
FLOOD_S = 3
VEHICLES = 1000


def shows_the_vehicle(opened):
    opened.until("document.getElementById('connection').textContent === 'bridge answers'")
    opened.until("document.querySelector('#vehicle dd')?.textContent === 'live'")


def first_paint_ms(opened):
    return opened.page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")


def loads(checks, browser, url, shots):
    checks.step("a page that loads")
    opened = browser.open(url)
    shows_the_vehicle(opened)
    # The least of a few: what the computer does beside it delays one load, and a slow page each. Nothing is cached.
    paint = first_paint_ms(opened)
    for _ in range(4):
        if paint < FIRST_PAINT_MS:
            break
        again = browser.open(url)
        shows_the_vehicle(again)
        paint = min(paint, first_paint_ms(again))
        again.context.close()
    checks.check(f"first paint within {FIRST_PAINT_MS} ms", paint < FIRST_PAINT_MS, paint)
    opened.until("document.querySelectorAll('.aircraft').length === 1")
    opened.page.wait_for_timeout(600)
    files = {one.url: one for one in opened.responses if "/page/" in one.url or one.url == opened.url}
    size = sum(len(gzip.compress(one.body(), mtime=0)) for one in files.values())
    checks.check(f"all of it is below {MAX_GZIPPED} bytes gzipped", 20_000 < size < MAX_GZIPPED, size)
    checks.say(f"{len(files)} files, {size} bytes gzipped, first paint after {paint:.0f} ms")
    policy = [one.all_headers().get("content-security-policy", "") for one in opened.responses]
    checks.check("each answer has the policy", policy and all("default-src 'none'" in one for one in policy), policy)
    checks.check("the console is empty", not opened.complaints, opened.complaints)
    checks.check("the policy has refused nothing of the page", opened.page.evaluate("window.violations") == [])
    checks.check("no other host was asked", not opened.elsewhere, opened.elsewhere)
    checks.check("nothing is kept but the units", opened.page.evaluate("Object.keys(localStorage).filter((k) => k !== 'units').length + Object.keys(sessionStorage).length") == 0)
    if shots:
        opened.page.screenshot(path=f"{shots}/page-light.png")

    checks.step("the ground under the map")
    opened.until("document.querySelectorAll('img.leaflet-tile-loaded').length > 0")
    sides = set(opened.page.evaluate("[...document.querySelectorAll('img.leaflet-tile-loaded')].map((one) => one.naturalWidth)"))
    checks.check("its pictures are those of the file", sides == {256}, sides)
    said = opened.text(".leaflet-control-attribution")
    checks.check("whose map it is is shown as a text", "a map of <b>chequers</b>" in said, said)

    checks.step("a text that would be code")
    opened.page.evaluate(
        "document.body.insertAdjacentHTML('beforeend', '<img src=x onerror=\"window.ran = 1\">');"
        "const s = document.createElement('script'); s.textContent = 'window.ran = 2'; document.body.append(s);"
    )
    # Of localhost: another origin than 127.0.0.1, and there all the same.
    other = opened.url.replace("127.0.0.1", "localhost")
    reached = opened.page.evaluate("(other) => fetch(other).then(() => true, () => false)", other)
    opened.page.wait_for_timeout(200)
    checks.check("it does not run", opened.page.evaluate("window.ran === undefined"))
    checks.check("another origin is not asked", reached is False)
    refused = opened.page.evaluate("window.violations.map((one) => one.split(' ')[0]).sort()")
    checks.check("the policy has refused each", {"connect-src", "script-src-attr", "script-src-elem"} <= set(refused), refused)
    opened.close()


def is_accessible(checks, browser, url, shots):
    for name, options in LOOKS.items():
        checks.step(f"accessible: {name}")
        opened = browser.open(url, **options)
        shows_the_vehicle(opened)
        opened.page.locator("details summary").first.click()
        found = opened.violations()
        checks.check("axe-core finds nothing", not found, found)
        checks.check("nothing is wider than the window", opened.wider_by() <= 0, opened.wider_by())
        tall = opened.page.evaluate("document.querySelector('#profile text').getBoundingClientRect().height")
        checks.check("the profile's texts can be read", tall >= 12, tall)
        if shots and name != "light":
            opened.page.screenshot(path=f"{shots}/page-{name}.png", full_page=name == "phone")
        opened.close()


def map_shows(checks, browser, url):
    """A vehicle with all that a map can show of it, of which the bridge's own has but a part."""
    checks.step("what the map shows")
    opened = browser.open(url)
    page = opened.page
    shows_the_vehicle(opened)
    body = page.evaluate("fetch('status.json').then((answer) => answer.json())")
    one = body["vehicles"][0]
    north, east, _ = one["position"]

    def place(up, right, amsl_m=520):
        return {"at": [north + up * 1e-4, east + right * 1e-4], "amsl_m": amsl_m}

    # A corner that is flown as a curve: by its chords.
    path = [place(0, 0), place(8, 0, 530), place(9.5, 1, 535), place(10, 3, 540), place(10, 9, 540)]
    waypoints = [path[0] | {"number": 10, "speed_m_s": None}, path[1] | {"number": 25, "speed_m_s": 8}, path[4] | {"number": 30, "speed_m_s": 4}]
    corners = [place(-5, -5)["at"], place(15, -5)["at"], place(15, 15)["at"], place(-5, 15)["at"]]
    shape = {
        "id": one["id"],
        "home": [*place(-2, -2)["at"], 488],
        "route": {"name": "CURVE", "aboard": True, "waypoints": waypoints, "path": path},
        "fence": {
            "aboard": True,
            "areas": [
                {"keep_in": True, "corners": corners, "radius_m": None},
                {"keep_in": False, "corners": [place(4, 6)["at"]], "radius_m": 20},
            ],
        },
        "rally": [place(2, 8)],
    }
    motion = one["motion"] | {"heading_deg": 90.0, "ground_speed_m_s": 6.5}
    looks_at = [{"station": 1, "centre": [*place(3, 3)["at"], 488], "range_m": 60}]
    vehicle = one | {"motion": motion, "looks_at": looks_at, "live": True}
    page.route("**/status.json*", lambda route: route.fulfill(json=body | {"vehicles": [vehicle]}))
    page.route("**/map.json*", lambda route: route.fulfill(json=[shape]))
    page.reload()
    opened.until("document.querySelectorAll('.waypoint').length === 3")
    opened.until("document.querySelector('.sight')")
    count = lambda selector: page.locator(selector).count()
    numbers = page.locator(".waypoint").all_inner_texts()
    checks.check("waypoints have the ground station's numbers", numbers == ["10", "25", "30"], numbers)
    drawn = page.locator("path.route").get_attribute("d")
    checks.check("a curve is drawn by its chords", drawn.count("L") == 4, drawn)
    checks.check("areas of the fence are drawn, each as what it is", (count("path.keep-in"), count("path.keep-out")) == (1, 1))
    marks = [page.locator(selector).all_inner_texts() for selector in (".home", ".rally", ".footprint")]
    checks.check("home, a rally point and the centre of an image are marked", marks == [["H"], ["R"], ["+"]], marks)
    turned = page.evaluate("document.querySelector('.aircraft i').style.transform")
    checks.check("the vehicle points where it heads", turned == "rotate(90deg)", turned)
    altitudes = page.locator("#profile polyline.route").get_attribute("points").split()
    checks.check("the profile has each place of the route", len(altitudes) == 5, altitudes)
    legs = (count("#profile line.speed"), count("#profile rect.flown-speed"))
    checks.check("and the commanded speeds, with the vehicle's as a square", legs == (2, 1), legs)

    checks.check("what the vehicle names is solid", count("path.not-aboard") == 0)
    shape["route"]["aboard"] = shape["fence"]["aboard"] = None
    opened.until("document.querySelector('path.not-aboard')")
    checks.check("what it does not name is dashed, route and fence", count("path.route.not-aboard") == 1 and count("path.not-aboard") == 3)
    checks.check("the console is empty", not opened.complaints, opened.complaints)
    opened.close()


def shows_each_event_once(checks, browser, url):
    checks.step("events, after a failed read and after a restart of the bridge")
    opened = browser.open(url)
    page = opened.page
    shows_the_vehicle(opened)
    same = (
        "fetch('events.json?from=0').then((answer) => answer.json())"
        ".then((all) => all.length > 0 && all.length === document.querySelectorAll('#events li').length)"
    )
    opened.until(same)
    page.route("**/status.json*", lambda route: route.abort())
    opened.until("document.getElementById('connection').textContent.startsWith('no answer')")
    page.unroute("**/status.json*")
    opened.until("document.getElementById('connection').textContent === 'bridge answers'")
    opened.until(same, 5)
    checks.check("none is shown twice", True)

    def status(route):
        route.fulfill(json=route.fetch().json() | {"uptime_s": 1.0})

    def events(route):
        first = {"number": 0, "at_ms": 1_767_225_600_000, "level": "info", "about": "1b:00:00:01", "text": "of the new run"}
        route.fulfill(json=[first] if route.request.url.endswith("from=0") else [])

    page.route("**/events.json*", events)
    page.route("**/status.json*", status)
    opened.until("document.getElementById('events').textContent.includes('of the new run')", 5)
    checks.check("those of another run take their place", page.locator("#events li").count() == 1, opened.text("#events"))
    opened.close()


def keeps_no_key_in_its_address(checks, browser, url):
    checks.step("a link with a key, where nothing can be commanded")
    opened = browser.open(f"{url}#1b:00:00:b0={'5a' * 32}")
    shows_the_vehicle(opened)
    checks.check("the key is gone from the address", "#" not in opened.page.url, opened.page.url)
    opened.close()


def by_keyboard(checks, browser, url):
    checks.step("by keyboard")
    opened = browser.open(url)
    page = opened.page
    shows_the_vehicle(opened)
    reached = []
    for _ in range(60):
        page.keyboard.press("Tab")
        here = page.evaluate("document.activeElement.id || document.activeElement.className || document.activeElement.tagName")
        if reached and here in ("BODY", reached[0]):
            break
        reached.append(here)
    wanted = {"skip", "choice", "units", "map", "only-refused", "events", "SUMMARY"}
    checks.check("all that can be used is reached", wanted <= {one.split(" ")[0] for one in reached}, reached)
    page.locator(".skip").focus()
    page.keyboard.press("Enter")
    checks.check("the map can be skipped", page.evaluate("document.activeElement.id") == "panel")
    page.locator("#units").focus()
    page.keyboard.press("f")
    checks.check("units are chosen", "ft" in opened.text("#vehicle"), opened.text("#vehicle"))
    page.keyboard.press("m")
    place = "document.querySelector('.leaflet-map-pane').style.transform"
    before = page.evaluate(place)
    page.locator("#map").focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(500)
    checks.check("the map is moved", page.evaluate(place) != before)
    shown = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
    checks.check("where the keyboard is, is seen", shown != "none", shown)
    checks.step("read aloud")
    live = page.evaluate("[...document.querySelectorAll('[aria-live], [role=status], [role=alert]')].map((one) => one.id)")
    checks.check("state and alerts are live regions", {"connection", "alerts"} <= set(live), live)
    opened.context.set_offline(True)
    opened.until("document.getElementById('connection').textContent.startsWith('no answer')")
    checks.check("a bridge that does not answer is named", page.evaluate("document.body.classList.contains('lost')"))
    opened.context.set_offline(False)
    opened.until("document.getElementById('connection').textContent === 'bridge answers'")
    opened.close()


def in_a_flood(checks, browser, url):
    """A thousand alerts a minute, each another text: half of them stand, all of them are events."""
    checks.step(f"{ALERTS_A_MINUTE} alerts a minute")
    opened = browser.open(url)
    page = opened.page
    shows_the_vehicle(opened)
    begun = time.monotonic()
    sent = [10_000]

    def due():
        return 10_000 + int((time.monotonic() - begun) * ALERTS_A_MINUTE / 60)

    def status(route):
        answer = route.fetch()
        body = answer.json()
        last = due()
        body["vehicles"][0]["alerts"] = [
            {"id": n, "priority": ["warning", "caution", "emergency"][n % 3], "text": f"fault {n} of a flood, of which nobody reads more than the first line"}
            for n in range(last - 60, last)
        ]
        route.fulfill(response=answer, json=body)

    def events(route):
        answer = route.fetch()
        body = answer.json()
        for n in range(sent[0], due()):
            body.append({"number": n, "at_ms": 1_767_225_600_000 + n, "level": "warning", "about": "1b:00:01:01", "text": f"fault {n} was refused and raised again, and again"})
        sent[0] = due()
        route.fulfill(response=answer, json=body)

    page.route("**/status.json*", status)
    page.route("**/events.json*", events)
    page.evaluate(
        "() => { window.longest = 0; let last = performance.now();"
        " const next = (now) => { window.longest = Math.max(window.longest, now - last); last = now; requestAnimationFrame(next); };"
        " requestAnimationFrame(next); }"
    )
    slowest, end = 0, time.monotonic() + FLOOD_S
    while time.monotonic() < end:
        slowest = max(slowest, opened.click_ms("#only-refused"))
        page.wait_for_timeout(100)
    shown = page.locator("#events li").count()
    standing = page.locator("#alerts li").count()
    longest = page.evaluate("window.longest")
    checks.say(f"{sent[0] - 10_000} alerts, {shown} events and {standing} alerts shown, slowest click {slowest:.0f} ms, longest frame {longest:.0f} ms")
    checks.check("they are shown", shown > ALERTS_A_MINUTE / 60 * FLOOD_S / 2 and standing >= 60, (shown, standing))
    checks.check(f"a click is answered within {ANSWER_WITHIN_MS} ms", slowest < ANSWER_WITHIN_MS, slowest)
    checks.check(f"no frame takes {ANSWER_WITHIN_MS} ms", longest < ANSWER_WITHIN_MS, longest)
    checks.check("the console is empty", not opened.complaints, opened.complaints)
    opened.close()


def with_a_thousand_vehicles(checks, browser, url):
    """What the bridge has of its one vehicle, a thousand times beside each other: a click is still answered at once."""
    checks.step(f"{VEHICLES} vehicles")
    opened = browser.open(url)
    page = opened.page
    shows_the_vehicle(opened)
    body = page.evaluate("fetch('status.json').then((answer) => answer.json())")
    one, shape = body["vehicles"][0], page.evaluate("fetch('map.json').then((answer) => answer.json())")[0]
    link = one["link"] | {"signed": True, "arrives": "verified"}
    # Each tenth is lost, each fourth in the air, one is not signed.
    named = [
        {
            "id": f"1b:00:{n // 256:02x}:{n % 256:02x}",
            "tail_number": f"UAV-{n:04}",
            "live": n % 10 != 0,
            "on_ground": n % 4 != 1,
            "link": link | {"signed": n != 5},
        }
        for n in range(VEHICLES)
    ]
    turn = [0]
    details = []

    def row(vehicle):
        short = {key: vehicle[key] for key in ("id", "tail_number", "live", "on_ground", "position", "battery_percent", "controller")}
        link = {key: vehicle["link"][key] for key in ("signed", "arrives")}
        return short | {"alert_count": len(vehicle["alerts"]), "link": link}

    def status(route):
        turn[0] += 1
        of = parse_qs(urlsplit(route.request.url).query, keep_blank_values=True).get("details")
        details.append(of and of[0])
        north, east, amsl_m = one["position"]
        places = [[north + (n // 40) * 2e-4 + turn[0] * 1e-5, east + (n % 40) * 3e-4, amsl_m] for n in range(VEHICLES)]
        vehicles = [one | name | {"position": place} for name, place in zip(named, places)]
        # As the bridge does: no id of these is a part of another.
        route.fulfill(json=body | {"vehicles": [each if of is None or each["id"] == of[0] else row(each) for each in vehicles]})

    def shapes(route):
        route.fulfill(json=[shape | {"id": name["id"]} for name in named])

    def offered():
        return page.evaluate("[...document.querySelectorAll('#choice option')].map((one) => one.textContent)")

    page.route("**/status.json*", status)
    page.route("**/map.json*", shapes)
    opened.until("document.querySelectorAll('#choice option').length > 100")
    texts = offered()
    checks.check("the list is short, and says how many more there are", len(texts) <= 202 and "more: choose by name or state" in texts[-1], texts[-2:])
    groups = page.evaluate("[...document.querySelectorAll('#group option')].map((one) => one.textContent)")
    expected = ["all (1000)", "linked (900)", "no data (100)", "in the air (250)", "not signed (1)"]
    checks.check("each group has its number", groups == expected, groups)
    page.evaluate("""window.drawn = 0;
        const watch = new MutationObserver((all) => { window.drawn += all.length; });
        for (const id of ["choice", "group"])
            watch.observe(document.getElementById(id), { childList: true, subtree: true, characterData: true });""")
    before = turn[0]
    took = []
    for _ in range(60):
        took.append(opened.click_ms("summary"))
        page.wait_for_timeout(100)
    checks.say(f"slowest click {max(took):.0f} ms, {turn[0] - before} ticks")
    checks.check(f"a click is answered within {ANSWER_WITHIN_MS} ms", max(took) < ANSWER_WITHIN_MS, max(took))
    drawn = page.evaluate("window.drawn")
    checks.check("a tick in which no vehicle is another draws no list", turn[0] > before and drawn == 0, drawn)
    page.locator("#group").select_option("lost")
    opened.until("[...document.querySelectorAll('#choice option')].filter((one) => one.textContent.endsWith('0 (' + one.value + ')')).length === 100")
    shown = page.locator("#choice").input_value()
    lost = [text for text in offered() if shown not in text]
    checks.check("a group has its own and none else but the one that is shown", len(lost) in (99, 100) and all(text[7] == "0" for text in lost), lost[:3])
    page.locator("#filter").fill("077")
    opened.until("document.querySelectorAll('#choice option').length <= 2")
    checks.check("name and group together", any("UAV-0770" in text for text in offered()), offered())
    page.locator("#group").select_option("all")
    page.locator("#filter").fill("0777")
    opened.until("[...document.querySelectorAll('#choice option')].some((one) => one.textContent.includes('UAV-0777'))")
    page.locator("#choice").select_option(label="UAV-0777 (1b:00:03:09)")
    opened.until("document.getElementById('vehicle-title').textContent.includes('UAV-0777')")
    checks.check("one of them is found by its name, and drawn whole", page.locator(".aircraft").count() == 1)
    # Until it has the first answer, the page knows of no vehicle, however often it asks.
    named = list(dropwhile(lambda detail: detail is None, details))
    checks.check("the bridge is asked for all of that one alone", details[-1] == "1b:00:03:09" and None not in named, details[:3] + details[-2:])
    checks.check("the console is empty", not opened.complaints, opened.complaints)
    opened.close()


def names_what_does_not_verify(checks, browser, url):
    """A vehicle that signs with another key: live, and in no way good."""
    checks.step("signed with another key")
    opened = browser.open(url)
    shows_the_vehicle(opened)

    def status(route):
        answer = route.fetch()
        body = answer.json()
        body["vehicles"][0]["link"].update(signed=True, verified_s=None, arrives="signed with another key")
        route.fulfill(response=answer, json=body)

    opened.page.route("**/status.json*", status)
    opened.until("document.getElementById('link').textContent.includes('NOT VERIFIED')")
    shown = opened.page.evaluate("[...document.querySelectorAll('#link dd')].filter((one) => one.textContent.includes('VERIFIED')).map((one) => [one.textContent, one.className])")
    checks.check("it names what arrives, as bad", shown == [["NOT VERIFIED: no frame has verified; what arrives: signed with another key", "bad"]], shown)
    checks.check("nothing says that it verified", "verified 0" not in opened.text("#link"), opened.text("#link"))
    opened.close()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("url")
    parser.add_argument("--shots")
    arguments = parser.parse_args()
    checks = Checks()
    with Browser() as browser:
        loads(checks, browser, arguments.url, arguments.shots)
        is_accessible(checks, browser, arguments.url, arguments.shots)
        map_shows(checks, browser, arguments.url)
        shows_each_event_once(checks, browser, arguments.url)
        keeps_no_key_in_its_address(checks, browser, arguments.url)
        by_keyboard(checks, browser, arguments.url)
        in_a_flood(checks, browser, arguments.url)
        with_a_thousand_vehicles(checks, browser, arguments.url)
        names_what_does_not_verify(checks, browser, arguments.url)
    checks.close()
    sys.exit(0 if checks.passed() else 1)


main()
