"""The browser in which tests look at pages, if there is one."""

import shutil

NAMES = ("chromium", "chromium-browser", "google-chrome")


def find() -> tuple[str, str] | None:
    """Paths of a browser and of the driver that Selenium needs; None unless there are both."""
    browser = next(filter(None, map(shutil.which, NAMES)), None)
    driver = shutil.which("chromedriver")
    return None if browser is None or driver is None else (browser, driver)
