import { expect, test, vi } from "vitest";
import { fetchConfig, fetchScene, fetchScenes, loadScene, training, unloadScene } from "./api";

function answer(make: (path: string, init: RequestInit) => Response | Promise<Response>): string[] {
  const asked: string[] = [];
  vi.stubGlobal("fetch", async (path: string, init: RequestInit) => {
    asked.push(`${init.method ?? "GET"} ${path}`);
    return make(path, init);
  });
  return asked;
}

test("asks where the protocol says, whatever a scene's name", async () => {
  const asked = answer(() => Response.json({ ladder: [] }));
  await fetchConfig();
  await fetchConfig(undefined, { scene: "a/b c", silent: "x&y" });
  await fetchScenes();
  await fetchScenes({ scan: true });
  await loadScene("a/b c");
  await loadScene("a", undefined, { host: "x&y" });
  await loadScene("a", undefined, { host: "x", coarse: true });
  await unloadScene("../x");
  await fetchScene("a b");
  await training("a b");
  await training("a b", "DELETE");
  expect(asked).toEqual([
    "GET config.json",
    "GET config.json?scene=a%2Fb+c&silent=x%26y",
    "GET scenes",
    "GET scenes?scan=1",
    "POST scenes/a%2Fb%20c/load",
    "POST scenes/a/load?host=x%26y",
    "POST scenes/a/load?coarse=1&host=x",
    "POST scenes/..%2Fx/unload",
    "GET scenes/a%20b",
    "GET scenes/a%20b/enhance",
    "DELETE scenes/a%20b/enhance",
  ]);
});

test("a server that is away does not answer", async () => {
  answer(() => Promise.reject(new TypeError("Failed to fetch")));
  await expect(fetchScenes()).rejects.toMatchObject({ message: "The server is not responding.", unreachable: true });
});

test.each(["null", "[]", '"ok"'])(
  "a configuration that is %s, of a proxy in between, counts as no answer",
  async (body) => {
    answer(() => new Response(body));
    await expect(fetchConfig()).rejects.toMatchObject({ unreachable: true });
  },
);
