// @vitest-environment happy-dom
import { cleanup, render, screen } from "@testing-library/preact";
import { afterEach, beforeEach, expect, test } from "vitest";
import { asSession, type FakeSession, fakeSession } from "#fakes/session";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { settings } from "../../state/app";
import { StageMessage } from "./stage-message";

let session: FakeSession;

beforeEach(() => {
  settings.value = DEFAULT_SETTINGS;
  session = fakeSession();
});

afterEach(cleanup);

const show = () => render(<StageMessage session={asSession(session)} />);

test.each([
  [{ kind: "connecting" }, "Connecting…"],
  [{ kind: "loading" }, "Loading the scene…"],
  [{ kind: "lost", message: "The server is not responding." }, "The server is not responding. Trying again…"],
  [{ kind: "full" }, "The server is full. The scene will open automatically as soon as there is room."],
] as const)("a visit that is %j says: %s", (phase, sentence) => {
  session.phase.value = phase;
  show();
  expect(screen.getByText(sentence)).toBeTruthy();
});

test.each([
  [{ kind: "connecting", message: "Starting the WebRTC stream…" }, "Starting the WebRTC stream…"],
  [{ kind: "lost", message: "The stream broke." }, "The stream broke. Trying again…"],
  [{ kind: "failed", message: "This browser cannot." }, "This browser cannot."],
  [{ kind: "playing", problem: "The server has no memory left." }, "The server has no memory left."],
] as const)("a picture that is %j says: %s", (phase, sentence) => {
  session.pictures.phase.value = phase;
  show();
  expect(screen.getByText(sentence)).toBeTruthy();
});
