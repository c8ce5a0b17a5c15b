// @vitest-environment happy-dom
import { act, cleanup, fireEvent, render, screen, within } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { ShaperStatus } from "#client/wire/shaper";
import { asSession, fakeSession } from "#fakes/session";
import { CONSTANT as REPORT } from "#fakes/shaper";
import { NetworkPanel } from "./network-panel";

vi.mock("../chart/plots", () => ({ plotLive: () => () => undefined }));

const LINK = { down_kbps: 20_000, up_kbps: 10_000, delay_ms: 10, jitter_ms: 0, loss_pct: 0 };
const DOWN = { target_kbps: 20_000, delivered_kbps: 12_340, queue_bytes: 0, queue_ms: 7.6, drops: 3 };
const CONSTANT: ShaperStatus = { ...REPORT, link: LINK, down: DOWN, up: { ...DOWN, delivered_kbps: 50 } };
const PLAYING: ShaperStatus = { ...CONSTANT, mode: "playing", trace: "bus", position_ms: 5000, duration_ms: 60_000 };
const TRACES = [
  { name: "bus", uploaded: false, duration_ms: 60_000, mean_down_kbps: 8000 },
  { name: "torn", uploaded: true, error: "torn.csv has no rows." },
];

/** The shaper's events, sent by the test. */
let events: {
  onopen?: () => void;
  onmessage?: (event: { data: string }) => void;
  onerror?: () => void;
  readyState: number;
  closed: boolean;
};
/** Requests to the shaper. */
let asked: [path: string, body: unknown][];
let refusal: string | null;
/** Traces that were uploaded. */
let own: { name: string; uploaded: boolean }[];

beforeEach(() => {
  asked = [];
  refusal = null;
  own = [];
  vi.stubGlobal(
    "EventSource",
    class {
      static readonly CLOSED = 2;
      readyState = 1;
      closed = false;
      constructor() {
        events = this;
      }
      close() {
        this.closed = true;
      }
    },
  );
  vi.stubGlobal("fetch", async (url: string, { body }: { body?: string | File }) => {
    const path = url.replace("http://shaper.test", "");
    if (path === "/traces") return Response.json({ traces: [...TRACES, ...own] });
    if (path === "/traces/mine") return Response.json({ times_ms: [0], down_kbps: [8000], duration_ms: 60_000 });
    if (path === "/traces/bus") return Response.json({ times_ms: [0], down_kbps: [8000], duration_ms: 60_000 });
    asked.push([path, typeof body === "string" ? JSON.parse(body) : null]);
    if (refusal) return Response.json({ type: "x", title: "", status: 409, detail: refusal }, { status: 409 });
    return Response.json(path.startsWith("/traces?") ? { name: "mine" } : PLAYING);
  });
});

afterEach(cleanup);

async function show(status: ShaperStatus = CONSTANT) {
  const page = render(<NetworkPanel base="http://shaper.test" session={asSession(fakeSession())} />);
  await act(async () => {
    events.onopen?.();
    events.onmessage?.({ data: JSON.stringify(status) });
  });
  await screen.findByRole("radio", { name: /bus/ });
  return page;
}

const tell = (status: ShaperStatus) => act(() => events.onmessage?.({ data: JSON.stringify(status) }));

test("until the shaper has told of its link, nothing is claimed", () => {
  render(<NetworkPanel base="http://shaper.test" session={asSession(fakeSession())} />);
  expect(screen.getByText("Connecting to the shaper…")).toBeTruthy();
});

test("shows what the link carries in both directions, and what it is", async () => {
  await show();
  const down = within(screen.getByRole("row", { name: /Down/ })).getAllByRole("cell");
  expect(down.map((cell) => cell.textContent)).toEqual(["20.0", "12.3", "8 ms", "3"]);
  expect(screen.getByText("Constant link; 20 ms round trip, 0 % loss, applied by the kernel's netem.")).toBeTruthy();
  await tell({ ...PLAYING, mode: "paused", backend: "relay" } as ShaperStatus);
  expect(
    screen.getByText("Paused: bus, 0:05 of 1:00; 20 ms round trip, 0 % loss, applied by the shaper's relay."),
  ).toBeTruthy();
});

test("a trace is chosen and played, once or over and over; one that is broken says why", async () => {
  const user = userEvent.setup();
  await show();
  expect(screen.getByRole("radio", { name: /torn/ })).toHaveProperty("disabled", true);
  expect(screen.getByText("torn.csv has no rows.")).toBeTruthy();
  await user.click(screen.getByRole("radio", { name: /bus/ }));
  await user.click(screen.getByRole("checkbox", { name: "Loop" }));
  await user.click(screen.getByRole("button", { name: "Play" }));
  expect(asked).toEqual([["/start", { trace: "bus", loop: false }]]);
});

test("what plays is paused, resumed, looped and stopped", async () => {
  const user = userEvent.setup();
  await show(PLAYING);
  await user.click(screen.getByRole("button", { name: "Pause" }));
  await tell({ ...PLAYING, mode: "paused" });
  await user.click(screen.getByRole("button", { name: "Resume" }));
  await user.click(screen.getByRole("checkbox", { name: "Loop" }));
  await user.click(screen.getByRole("button", { name: "Stop" }));
  expect(asked).toEqual([
    ["/pause", {}],
    ["/resume", {}],
    ["/loop", { loop: true }],
    ["/stop", {}],
  ]);
});

test("one goes to another place of the trace that plays", async () => {
  await show();
  expect(screen.queryByRole("slider")).toBeNull();
  await tell(PLAYING);
  const slider = screen.getByRole("slider", { name: "Position in the trace" });
  fireEvent.change(slider, { target: { value: "30000" } });
  await vi.waitFor(() => expect(asked).toEqual([["/seek", { position_ms: 30_000 }]]));
});

test("a trace of one's own is kept and chosen; why one is not is said", async () => {
  await show();
  const file = screen.getByLabelText("Trace file");
  own.push({ name: "mine", uploaded: true });
  await userEvent.upload(file, new File(["t_ms,down_kbps\n"], "mine.csv"));
  await vi.waitFor(() => expect(screen.getByRole("radio", { name: /mine/ })).toHaveProperty("checked", true));
  expect(asked).toEqual([["/traces?name=mine.csv", null]]);
  refusal = "mine.csv has no rows.";
  await userEvent.upload(file, new File([""], "mine.csv"));
  expect((await screen.findByText("mine.csv has no rows.")).getAttribute("role")).toBe("alert");
});

test("a constant link is set from what was typed, and what is wrong is said", async () => {
  const user = userEvent.setup();
  await show();
  const form = within(screen.getByRole("form", { name: "Constant link" }));
  const down = form.getByRole("textbox", { name: /Down/ });
  await user.clear(down);
  await user.type(down, "fast");
  await user.click(form.getByRole("button", { name: "Set constant link" }));
  expect(form.getByRole("alert").textContent).toBe("Down must be a number from 0 to 100,000 Mbit/s.");
  expect(down.getAttribute("aria-invalid")).toBe("true");
  expect(asked).toEqual([]);
  await user.clear(down);
  await user.type(down, "2,5");
  await user.click(form.getByRole("button", { name: "Set constant link" }));
  expect(asked).toEqual([["/link", { ...LINK, down_kbps: 2500 }]]);
});

test("a refusal is said, and forgotten when something succeeds", async () => {
  const user = userEvent.setup();
  await show(PLAYING);
  refusal = "Another page has the link.";
  await user.click(screen.getByRole("button", { name: "Stop" }));
  expect((await screen.findByText("Another page has the link.")).getAttribute("role")).toBe("alert");
  refusal = null;
  await user.click(screen.getByRole("button", { name: "Pause" }));
  await vi.waitFor(() => expect(screen.queryByText("Another page has the link.")).toBeNull());
});

test("a link that is closed, and a shaper that is lost, are said", async () => {
  const { unmount } = await show({ ...CONSTANT, closed: "The gateway has no route." });
  expect(screen.getByText("The gateway has no route.")).toBeTruthy();
  await act(() => events.onerror?.());
  expect(screen.getByRole("alert").textContent).toContain("http://shaper.test is not responding");
  expect(screen.queryByRole("table")).toBeNull();
  unmount();
  await vi.waitFor(() => expect(events.closed).toBe(true));
});
