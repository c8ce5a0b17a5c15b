// @vitest-environment happy-dom
import { beforeEach, expect, test, vi } from "vitest";
import { playStream } from "./dashjs-stream";

/**
 * The relevant part of dash.js: a player that waits until its video can play, as `VideoModel.setPlaybackRate` of 5.2
 * does.
 */
const players = vi.hoisted(() => [] as { element: HTMLVideoElement | null; rates: number }[]);
vi.mock("dashjs", () => {
  const create = () => {
    const player = { element: null as HTMLVideoElement | null, rates: 0 };
    players.push(player);
    return {
      updateSettings: () => undefined,
      on: () => undefined,
      getVersion: () => "5",
      initialize: (video: HTMLVideoElement) => {
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
  return { supportsMediaSource: () => true, MediaPlayer: Object.assign(() => ({ create }), { events: {} }) };
});

const EVENTS = { received: () => undefined, failed: () => undefined };
let video: HTMLVideoElement;

beforeEach(() => {
  players.length = 0;
  video = document.createElement("video");
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
