// @vitest-environment happy-dom
import { beforeEach, expect, test, vi } from "vitest";
import { StreamUnsupported } from "../stream/stream";
import { playStream } from "./dashjs-stream";

/**
 * The relevant part of dash.js: a player that waits until its video can play, as `VideoModel.setPlaybackRate` of 5.2
 * does.
 */
const players = vi.hoisted(() => [] as { element: HTMLVideoElement | null; rates: number; warnings: number }[]);
vi.mock("dashjs", () => {
  const create = () => {
    const player = { element: null as HTMLVideoElement | null, rates: 0, warnings: 0 };
    players.push(player);
    return {
      updateSettings: () => undefined,
      on: () => undefined,
      getVersion: () => "5",
      initialize: (video: HTMLVideoElement) => {
        video.play().catch(() => player.warnings++);
        player.element = video;
        video.addEventListener("canplay", () => {
          player.rates++;
          if (player.element === null) throw new TypeError("Cannot set properties of null (setting 'playbackRate')");
        });
      },
      destroy: () => {
        player.element = null;
      },
    };
  };
  return { MediaPlayer: Object.assign(() => ({ create }), { events: {} }) };
});

// Like the browser: a play request ends with its stream.
let interrupt: (error: Error) => void;
const EVENTS = { received: () => undefined, failed: () => undefined };
let video: HTMLVideoElement;

beforeEach(() => {
  players.length = 0;
  vi.stubGlobal("MediaSource", { isTypeSupported: () => true });
  video = document.createElement("video");
  video.play = () => new Promise((_, reject) => (interrupt = reject));
});

test("a player that has gone hears nothing of the video that the next one plays", () => {
  const listen = video.addEventListener;
  playStream(video, "/a.mpd", EVENTS).dispose();
  const next = playStream(video, "/b.mpd", EVENTS);
  video.dispatchEvent(new Event("canplay"));
  expect(players.map(({ rates }) => rates)).toEqual([0, 1]);
  next.dispose();
  video.dispatchEvent(new Event("canplay"));
  expect(players.map(({ rates }) => rates)).toEqual([0, 1]);
  expect(video.addEventListener).toBe(listen);
});

test("a play request interrupted by the end of the stream is no problem; another one is", async () => {
  const stream = playStream(video, "/a.mpd", EVENTS);
  interrupt(new Error("not allowed"));
  await vi.waitFor(() => expect(players[0]?.warnings).toBe(1));
  stream.dispose();
  playStream(video, "/b.mpd", EVENTS).dispose();
  interrupt(new Error("interrupted"));
  await Promise.resolve();
  await Promise.resolve();
  expect(players[1]?.warnings).toBe(0);
});

test("a browser without H.264 is told so, also where only managed extensions exist", () => {
  const none = { isTypeSupported: () => false };
  vi.stubGlobal("MediaSource", none);
  expect(() => playStream(video, "/a.mpd", EVENTS)).toThrow(StreamUnsupported);
  vi.stubGlobal("MediaSource", undefined);
  vi.stubGlobal("ManagedMediaSource", none);
  expect(() => playStream(video, "/a.mpd", EVENTS)).toThrow(StreamUnsupported);
  expect(players).toEqual([]);
});
