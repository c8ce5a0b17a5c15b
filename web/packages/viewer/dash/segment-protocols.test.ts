import { expect, test, vi } from "vitest";
import { SegmentProtocols } from "./segment-protocols";

test("protocols of the stream's own segments are kept, each once", () => {
  let report: PerformanceObserverCallback = () => undefined;
  const disconnect = vi.fn();
  vi.stubGlobal(
    "PerformanceObserver",
    class {
      constructor(callback: PerformanceObserverCallback) {
        report = callback;
      }
      observe() {}
      disconnect = disconnect;
    },
  );
  const protocols = new SegmentProtocols("https://render/services/dash/sessions/a/");
  const fetched = (path: string, nextHopProtocol: string) => ({ name: `https://render/${path}`, nextHopProtocol });
  const entries = [
    fetched("services/dash/sessions/a/r3-500/1.m4s", "h3"),
    fetched("services/dash/sessions/a/r3-500/2.m4s", "h3"),
    fetched("services/dash/sessions/a/r3-500/3.m4s", ""),
    fetched("services/dash/sessions/a/r3-500/init.mp4", "h2"),
    fetched("services/dash/sessions/b/r3-500/1.m4s", "http/1.1"),
    fetched("config.json", "http/1.1"),
  ];
  report({ getEntries: () => entries } as unknown as PerformanceObserverEntryList, {} as PerformanceObserver);
  expect(protocols.seen).toEqual(["h3"]);
  protocols.dispose();
  expect(disconnect).toHaveBeenCalledOnce();
});
