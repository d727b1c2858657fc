"""The browser in which tests open pages."""

import os
from collections.abc import Iterator
from typing import Any

import pytest

from thesis_lib.book.pdf import chromium as find_chromium


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium without a screen; a machine without it skips, continuous integration fails."""
    if (found := find_chromium()) is None:
        message = "there is no chromium on this machine: install it (Debian: apt install chromium)"
        if os.environ.get("CI") == "true":
            pytest.fail(message)
        pytest.skip(message)
    from playwright.sync_api import sync_playwright

    flags = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=found, headless=True, args=flags)
        yield chromium
        chromium.close()
