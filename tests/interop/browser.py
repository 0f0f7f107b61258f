"""A headless Chromium on the operator's page, and what every test of the page watches: requests, console, errors, the policy.

Chromium is Debian's; Playwright brings its driver in its own package. Nothing is reached but 127.0.0.1: a request to another host is
stopped here, and is a failure of the test.
"""

import shutil
import time
from urllib.parse import urlsplit

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

NAMES = ["chromium", "chromium-browser", "google-chrome"]
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
PHONE = {"width": 390, "height": 844}
DESK = {"width": 1280, "height": 800}
LOOKS = {
    "light": {},
    "dark": {"color_scheme": "dark"},
    "phone": {"viewport": PHONE, "is_mobile": True, "has_touch": True},
}
# A person takes less for an answer at once; a machine that builds beside it needs some of it.
ANSWER_WITHIN_MS = 700


class Browser:
    """One process of Chromium; ends with the `with`."""

    def __enter__(self):
        found = next((path for path in map(shutil.which, NAMES) if path), None)
        assert found, f"none of {', '.join(NAMES)} is installed"
        self._driver = sync_playwright().start()
        self._chromium = self._driver.chromium.launch(executable_path=found, headless=True, args=ARGUMENTS)
        return self

    def __exit__(self, *_):
        self._chromium.close()
        self._driver.stop()

    def open(self, url, viewport=DESK, **options):
        """A page in a context of its own: nothing is remembered from another."""
        return Opened(self._chromium.new_context(viewport=viewport, **options), url)


class Opened:
    """A page that is open, and what happened on it."""

    def __init__(self, context, url):
        self.context = context
        self.url = url
        self.complaints = []
        self.elsewhere = []
        self.responses = []
        context.route("**/*", self._keep_here)
        self.page = context.new_page()
        # Before any script of the page: what the policy refuses is counted from the first.
        self.page.add_init_script(
            "window.violations = [];"
            "document.addEventListener('securitypolicyviolation', (e) => window.violations.push(`${e.violatedDirective} ${e.blockedURI}`));"
        )
        self.page.on("console", lambda message: self.complaints.append(f"{message.type}: {message.text}"))
        self.page.on("pageerror", lambda error: self.complaints.append(f"error: {error}"))
        self.page.on("response", lambda response: self.responses.append(response))
        self.page.goto(url)

    def _keep_here(self, route):
        if urlsplit(route.request.url).netloc == urlsplit(self.url).netloc:
            route.fallback()
        else:
            self.elsewhere.append(route.request.url)
            route.abort()

    def close(self):
        # A handler of a route that is at work when its page goes fails at whatever is done next with the browser.
        self.page.unroute_all(behavior="wait")
        self.context.unroute_all(behavior="wait")
        self.context.close()

    def text(self, selector):
        return self.page.locator(selector).inner_text()

    def violations(self):
        """What axe-core finds of the page as it stands."""
        found = Axe().run(self.page, options={"resultTypes": ["violations"]}).response["violations"]
        return [f"{one['id']}: {node['html'][:120]}" for one in found for node in one["nodes"]]

    def wider_by(self):
        """Pixels that the page is wider than the window."""
        return self.page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")

    def click_ms(self, selector):
        """How long the page takes to answer a click."""
        return self.page.evaluate(
            """(selector) => new Promise((done) => {
                const begun = performance.now();
                document.querySelector(selector).click();
                requestAnimationFrame(() => setTimeout(() => done(performance.now() - begun)));
            })""",
            selector,
        )

    def until(self, expression, within_s=30):
        """Waits until JavaScript holds on the page."""
        # Not wait_for_function: what it runs on the page later is refused by the page's policy.
        end = time.monotonic() + within_s
        while not self.page.evaluate(expression):
            assert time.monotonic() < end, f"not within {within_s} s: {expression}\n{self.page.locator('body').inner_text()}"
            self.page.wait_for_timeout(50)
