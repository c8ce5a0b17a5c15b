"""A module of the page, and nothing else of it, on a page of its own."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from playwright.sync_api import Page, Route

WEB = Path(__file__).parents[2] / "web"
ORIGIN = "http://localhost:1/"
"""Nothing listens there: the test answers. Some of what browsers have needs a secure context."""
BUNDLE = """
import { build } from "vite";
const [entry, outDir] = process.argv.slice(1);
const lib = { entry, formats: ["es"], fileName: "module" };
await build({ configFile: false, logLevel: "error", publicDir: false, build: { lib, outDir } });
"""


def bundled(entry: str, folder: Path) -> str:
    """The JavaScript of a module, such as `src/enhance/models/scene.ts`, with all that it imports."""
    if shutil.which("node") is None or not (WEB / "node_modules").exists():
        pytest.skip("the web client's packages are not installed: cd web && npm ci")
    command = ["node", "--input-type=module", "--eval", BUNDLE, entry, str(folder)]
    subprocess.run(command, cwd=WEB, check=True, timeout=60)
    return (folder / "module.js").read_text()


def open_with(page: Page, **modules: str) -> None:
    """Open an empty page that can import each module by its name: `import("/name.js")`."""

    def answer(route: Route) -> None:
        name = route.request.url.removeprefix(ORIGIN).removesuffix(".js")
        kind = "text/javascript" if name in modules else "text/html"
        route.fulfill(body=modules.get(name, "<!doctype html>"), content_type=kind)

    page.route(f"{ORIGIN}**", answer)
    page.goto(ORIGIN)
