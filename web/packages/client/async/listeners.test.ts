import { expect, test } from "vitest";
import { Listeners } from "./listeners";

test("everybody hears of it until told to stop", () => {
  const heard: string[] = [];
  const listeners = new Listeners<[news: string]>();
  const stop = listeners.add((news) => heard.push(`first: ${news}`));
  listeners.add((news) => heard.push(`second: ${news}`));
  listeners.tell("one");
  stop();
  listeners.tell("two");
  expect(heard).toEqual(["first: one", "second: one", "second: two"]);
});
