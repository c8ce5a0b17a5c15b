"""A single module of the page, on a separate page."""

from __future__ import annotations

import subprocess
from pathlib import Path

from playwright.sync_api import Page, Route

from tests.prerequisites import NODE_MODULES

WEB = Path(__file__).parents[2] / "web"
ORIGIN = "http://localhost:1/"
"""An unused address: the test answers. Some browser features need a secure context."""
BUNDLE = """
import { build } from "vite";
const [entry, outDir] = process.argv.slice(1);
const lib = { entry, formats: ["es"], fileName: "module" };
const resolve = { tsconfigPaths: true };
const rolldownOptions = { output: { codeSplitting: false } }; // one file
const options = { lib, outDir, rolldownOptions };
await build({ configFile: false, logLevel: "error", publicDir: false, resolve, build: options });
"""


def bundled(entry: str, folder: Path) -> str:
    """The JavaScript of a module, such as `packages/viewer/enhance/models/scene.ts`, with all that it imports."""
    NODE_MODULES.require()
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
