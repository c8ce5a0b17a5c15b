import { expect, test, vi } from "vitest";
import { ShaperApi } from "./api";

function answer(make: () => Response | Promise<Response>): string[] {
  const asked: string[] = [];
  vi.stubGlobal("fetch", async (url: string, { method = "GET", body = "" }: RequestInit) => {
    asked.push(`${method} ${url} ${body}`.trim());
    return make();
  });
  return asked;
}

test("asks where the shaper answers, whatever a trace's name", async () => {
  const asked = answer(() => Response.json({}));
  const api = new ShaperApi("http://lab:8090/");
  await api.traces();
  await api.trace("a/b c");
  await api.start({ trace: "bus", loop: false });
  await api.pause();
  await api.resume();
  await api.stop();
  await api.loop(true);
  await api.link({ down_kbps: 1, up_kbps: 2 });
  expect(asked).toEqual([
    "GET http://lab:8090/traces",
    "GET http://lab:8090/traces/a%2Fb%20c",
    'POST http://lab:8090/start {"trace":"bus","loop":false}',
    "POST http://lab:8090/pause {}",
    "POST http://lab:8090/resume {}",
    "POST http://lab:8090/stop {}",
    'POST http://lab:8090/loop {"loop":true}',
    'POST http://lab:8090/link {"down_kbps":1,"up_kbps":2}',
  ]);
});

test("a shaper that is away is named", async () => {
  answer(() => Promise.reject(new TypeError("Failed to fetch")));
  await expect(new ShaperApi("http://lab:1/").traces()).rejects.toThrow("The shaper at http://lab:1 is not responding");
});
