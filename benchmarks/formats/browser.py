"""How long Chromium takes to decode pictures, as the page does it: a blob into a bitmap, in a worker."""

from __future__ import annotations

import base64
from collections.abc import Sequence

from playwright.sync_api import sync_playwright

from tigas_experiments.run.browser import find_chromium

REPEATS = 9
"""The least time of so many is taken, after one to warm up."""

_TIME = """([mime, content, repeats]) => {
    const inWorker = async ({ data: [blob, repeats] }) => {
        let least = null;
        for (let i = 0; i <= repeats; i++) {
            const start = performance.now();
            try { (await createImageBitmap(blob)).close(); } catch { break; }
            const took = performance.now() - start;
            if (i > 0 && (least === null || took < least)) least = took;
        }
        postMessage(least);
    };
    const worker = new Worker(URL.createObjectURL(new Blob([`onmessage = ${inWorker}`])));
    const bytes = Uint8Array.from(atob(content), (each) => each.charCodeAt(0));
    return new Promise((resolve) => {
        worker.onmessage = ({ data }) => { worker.terminate(); resolve(data); };
        worker.postMessage([new Blob([bytes], { type: mime }), repeats]);
    });
}"""


def decode_times(pictures: Sequence[tuple[str, bytes]]) -> list[float | None]:
    """Milliseconds for each MIME type and body; None for what this browser cannot decode."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium())
        try:
            page = browser.new_page()
            return [page.evaluate(_TIME, [mime, base64.b64encode(body).decode(), REPEATS]) for mime, body in pictures]
        finally:
            browser.close()
