"""A recording of a flight in a browser: its time line is played, stopped and sought, by mouse and by keyboard.

    page_replays.py http://127.0.0.1:8587/ [--shots DIR]
"""

import argparse
import re
import sys
from urllib.parse import parse_qs, urlsplit

from browser import Browser
from checks import Checks


def place(page):
    return page.evaluate("[...document.querySelectorAll('#vehicle dt')].find((one) => one.textContent === 'position')?.nextSibling.textContent")


def moment(page):
    return int(page.locator("#moment").input_value())


def begins_once(checks, browser, url):
    """Where the tracks cannot be read at first."""
    checks.step("a recording whose tracks are read twice")
    opened = browser.open(url)
    page = opened.page
    opened.until("document.getElementById('connection').textContent.startsWith('a recording')")
    page.route("**/tracks.json", lambda route: route.abort())
    page.reload()
    opened.until("document.getElementById('connection').textContent.startsWith('no answer')")
    page.unroute("**/tracks.json")
    opened.until("document.getElementById('connection').textContent.startsWith('a recording')")
    layers = page.locator(".leaflet-tile-pane > .leaflet-layer").count()
    checks.check("all that is made of it is made once: one layer is under the map", layers == 1, layers)
    opened.close()


def keeps_nothing_of_a_moment_that_was_left(checks, opened):
    """The beginning is sought while the events of the end are on their way."""
    checks.step("sought while it is read")
    page = opened.page
    at = lambda request: int(parse_qs(urlsplit(request.url).query)["at"][0])
    with page.expect_request("**/events.json*") as first:
        pass
    begin, late = at(first.value), []

    def hold(route):
        if not late and at(route.request) > begin + 1_000:
            late.append(route)
        else:
            route.fallback()

    page.route("**/events.json*", hold)
    page.locator("#moment").focus()
    page.keyboard.press("End")
    for _ in range(100):
        if late:
            break
        page.wait_for_timeout(50)
    page.keyboard.press("Home")
    late[0].fallback()
    page.wait_for_timeout(1_500)
    checks.check("its events are not kept", "mode 21" not in opened.text("#events"), opened.text("#events"))
    page.unroute("**/events.json*", hold)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("url")
    parser.add_argument("--shots")
    arguments = parser.parse_args()
    checks = Checks()
    with Browser() as browser:
        opened = browser.open(arguments.url)
        page = opened.page
        checks.step("a recording")
        opened.until("document.getElementById('connection').textContent.startsWith('a recording')")
        opened.until("document.querySelector('#vehicle dd')")
        checks.check("the time line is there", page.locator("#timeline").is_visible())
        checks.check("nothing can be commanded", not page.locator("#control").is_visible())
        checks.check("it says that no signatures are recorded", "signatures are not recorded" in opened.text("#link"), opened.text("#link"))

        scale = opened.text(".leaflet-control-scale-line >> nth=0")
        checks.check("the map begins where it was flown", re.fullmatch(r"\d+ m", scale), scale)
        opened.until("document.querySelectorAll('img.leaflet-tile-loaded').length > 0")
        checks.check("the ground of its file is under the map", True)

        checks.step("played")
        begun, at_first = place(page), moment(page)
        page.locator("#speed").select_option("20")
        places = lambda: page.locator("#back").bounding_box()["x"]
        still = places()
        page.locator("#play").click()
        checks.check("no button moves away as Play becomes Pause", places() == still, (still, places()))
        opened.until("Number(document.getElementById('moment').value) > 8000")
        page.locator("#play").click()
        stopped = moment(page)
        page.wait_for_timeout(400)
        checks.check("it advances, and stops where it is stopped", at_first < stopped == moment(page), (at_first, stopped, moment(page)))

        checks.step("sought")
        page.locator("#moment").focus()
        page.keyboard.press("End")
        opened.until("document.querySelector('path.route')")
        opened.until("document.querySelectorAll('.waypoint').length === 4")
        page.wait_for_timeout(500)
        checks.check("the vehicle is elsewhere at the end", place(page) not in (None, begun), place(page))
        track = page.locator("path.track").get_attribute("d")
        checks.check("its track is drawn", track.count("L") >= 3, track)
        events = opened.text("#events")
        checks.check("who controlled is among the events", "holds LOI" in events and "mode 21 (launch)" in events, events)
        checks.check("who controls is shown", "1b:00:00:a0 (controls)" in opened.text("#holders"), opened.text("#holders"))
        if arguments.shots:
            page.screenshot(path=f"{arguments.shots}/page-replay.png")
        page.keyboard.press("Home")
        opened.until("!document.querySelector('path.route')")
        checks.check("at the beginning it has no route yet", page.locator(".waypoint").count() == 0)
        opened.until("!document.getElementById('events').textContent.includes('mode 21')")
        checks.check("and nothing of later", "commands" not in opened.text("#events"), opened.text("#events"))
        keeps_nothing_of_a_moment_that_was_left(checks, opened)
        page.keyboard.press("ArrowRight")
        checks.check("an arrow advances it a little", 0 < moment(page) <= 1000, moment(page))
        page.locator("#forward").click()
        checks.check("a button by 10 s", 10_000 < moment(page) <= 11_000, moment(page))
        spoken = page.locator("#moment").get_attribute("aria-valuetext")
        checks.check("the moment is spoken as a time", spoken.endswith("UTC"), spoken)

        checks.step("accessible")
        found = opened.violations()
        checks.check("axe-core finds nothing", not found, found)
        checks.check("the console is empty", not opened.complaints, opened.complaints)
        checks.check("no other host was asked", not opened.elsewhere, opened.elsewhere)
        opened.close()
        begins_once(checks, browser, arguments.url)
    checks.close()
    sys.exit(0 if checks.passed() else 1)


main()
