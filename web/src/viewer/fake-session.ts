/** A visit for tests of its views: no connection, all state set by the test. */
import { computed, signal } from "@preact/signals";
import type { EnhancementStatus } from "../enhance/enhancement";
import { type LocalPhase, type LocalPlayer, type LocalStats, NO_LOCAL_STATS } from "../local/local-player";
import { MovementDeck } from "../movement/movement-deck";
import { type ReprojectionStatus, reprojectionNote } from "../reproject/reprojector";
import { settings } from "../state/app";
import { COURTYARD } from "../state/fake-server";
import { isPerView, isStreamed } from "../state/settings";
import { type Place, settingsAt } from "../state/sides";
import { NO_STATS, type Stats } from "../stateless/stats";
import type { StreamPhase, StreamPlayer, StreamStats } from "../stream/stream-player";
import { NO_STREAM_STATS } from "../stream/stream-player";
import type { Connected } from "../transport/connect";
import type { ConnectionState } from "../transport/connection";
import type { Figures } from "../view/meter";
import { NO_NUDGE } from "../view/motion";
import { Rig } from "../view/rig";
import type { SceneInfo } from "../wire/render";
import type { Comparison } from "./comparison";
import type { Phase, ViewerSession } from "./session";

const STILL = { forward: 0, right: 0, up: 0, turnRight: 0, turnUp: 0 };

/** A side of the stage without a picture. */
export function fakeSide(place: Place) {
  const status = signal<EnhancementStatus>({ kind: "off" });
  const fake = {
    settings: computed(() => settingsAt(place, settings.value)),
    video: { problem: signal<string | null>(null) },
    stateless: { stats: signal<Stats>(NO_STATS), problem: signal<string | null>(null) },
    enhancement: {
      status,
      giveUp: (message: string) => {
        status.value = { kind: "failed", message };
      },
    },
    reprojector: { status: signal<ReprojectionStatus>("on") },
    videoReprojector: { status: signal<ReprojectionStatus>("on") },
    stream: signal<StreamPlayer | null>(null),
    local: signal<LocalPlayer | null>(null),
    unturned: computed((): string | null =>
      reprojectionNote(fake.reprojector.status.value, fake.videoReprojector.status.value),
    ),
    get figures(): Figures | null {
      const { mode } = fake.settings.value;
      if (isPerView(mode)) return fake.stateless.stats.value;
      return (isStreamed(mode) ? fake.stream : fake.local).value?.stats.value ?? null;
    },
    picture: () => null,
    onPresented: () => () => undefined,
  };
  return fake;
}

type FakeSide = ReturnType<typeof fakeSide>;

/** In the scene, playing. */
export function fakeSession() {
  const rig = new Rig({ sampleInput: () => ({ axes: STILL, nudge: NO_NUDGE }), turnSpeed: () => 60 });
  rig.resize(1280, 720);
  rig.enter(COURTYARD);
  const left = fakeSide("left");
  const right = signal<FakeSide | null>(null);
  const fake = {
    phase: signal<Phase>({ kind: "playing" }),
    scene: signal<SceneInfo | null>(COURTYARD),
    connected: signal<Connected | null>(null),
    silent: signal(false),
    rig,
    movement: new MovementDeck(rig),
    left,
    right,
    stateless: left.stateless,
    video: left.video,
    reprojector: left.reprojector,
    stream: left.stream,
    local: left.local,
    enhancement: {
      ...left.enhancement,
      renew: () => {
        fake.renewals++;
      },
    },
    comparison: signal<Comparison | null>(null),
    rightConnection: signal<ConnectionState | null>(null),
    unturned: computed(() => left.unturned.value ?? right.value?.unturned.value ?? null),
    seed: signal(1),
    input: { pad: { forward: 0, right: 0, up: 0 } },
    receivedBytes: 0,
    retries: 0,
    renewals: 0,
    disposed: false,
    retry: () => {
      fake.retries++;
    },
    onPresented: () => () => undefined,
    onShown: () => () => undefined,
    onSent: () => () => undefined,
    onReplied: () => () => undefined,
    dispose: () => {
      fake.disposed = true;
    },
  };
  return fake;
}

export type FakeSession = ReturnType<typeof fakeSession>;

export function asSession(fake: FakeSession): ViewerSession {
  return fake as unknown as ViewerSession;
}

/** The stream of a visit. */
export function fakeStream(phase: StreamPhase, stats: Partial<StreamStats> = {}): StreamPlayer {
  const status = async () => null;
  return { phase: signal(phase), stats: signal({ ...NO_STREAM_STATS, ...stats }), status } as unknown as StreamPlayer;
}

/** Downloads for a fake visit. */
export function fakeLocal(phase: LocalPhase, stats: Partial<LocalStats> = {}): LocalPlayer {
  return { phase: signal(phase), stats: signal({ ...NO_LOCAL_STATS, ...stats }) } as unknown as LocalPlayer;
}
