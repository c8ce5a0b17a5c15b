/** A visit for tests of what shows it: nothing is connected, and the test says how it stands. */
import { signal } from "@preact/signals";
import type { DashPhase, DashPlayer, DashStats } from "../dash/dash-player";
import { NO_DASH_STATS } from "../dash/dash-player";
import type { EnhancementStatus } from "../enhance/enhancement";
import { type LocalPhase, type LocalPlayer, type LocalStats, NO_LOCAL_STATS } from "../local/local-player";
import { MovementDeck } from "../movement/movement-deck";
import type { ReprojectionStatus } from "../reproject/reprojector";
import { COURTYARD } from "../state/fake-server";
import { NO_STATS, type Stats } from "../stateless/stats";
import type { Connected } from "../transport/connect";
import { NO_NUDGE } from "../view/motion";
import type { PresentedFrame } from "../view/presented";
import { Rig } from "../view/rig";
import type { SceneInfo } from "../wire/render";
import type { Phase, ViewerSession } from "./session";

const STILL = { forward: 0, right: 0, up: 0, turnRight: 0, turnUp: 0 };

/** In the scene, playing. */
export function fakeSession() {
  const rig = new Rig({ sampleInput: () => ({ axes: STILL, nudge: NO_NUDGE }), turnSpeed: () => 60 });
  rig.resize(1280, 720);
  rig.enter(COURTYARD);
  const listeners = new Set<(frame: PresentedFrame) => void>();
  const fake = {
    phase: signal<Phase>({ kind: "playing" }),
    scene: signal<SceneInfo | null>(COURTYARD),
    connected: signal<Connected | null>(null),
    silent: signal(false),
    rig,
    movement: new MovementDeck(rig),
    video: { problem: signal<string | null>(null) },
    stateless: { stats: signal<Stats>(NO_STATS), problem: signal<string | null>(null) },
    enhancement: {
      status: signal<EnhancementStatus>({ kind: "off" }),
      giveUp: (message: string) => {
        fake.enhancement.status.value = { kind: "failed", message };
      },
      renew: () => {
        fake.renewals++;
      },
    },
    reprojector: { status: signal<ReprojectionStatus>("on") },
    videoReprojector: { status: signal<ReprojectionStatus>("on") },
    dash: signal<DashPlayer | null>(null),
    local: signal<LocalPlayer | null>(null),
    seed: signal(1),
    input: { pad: { forward: 0, right: 0, up: 0 } },
    receivedBytes: 0,
    retries: 0,
    renewals: 0,
    disposed: false,
    retry: () => {
      fake.retries++;
    },
    onPresented: (listener: (frame: PresentedFrame) => void) => {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
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

/** The DASH side of a visit. */
export function fakeDash(phase: DashPhase, stats: Partial<DashStats> = {}): DashPlayer {
  return { phase: signal(phase), stats: signal({ ...NO_DASH_STATS, ...stats }) } as unknown as DashPlayer;
}

/** What downloads the scene of a visit. */
export function fakeLocal(phase: LocalPhase, stats: Partial<LocalStats> = {}): LocalPlayer {
  return { phase: signal(phase), stats: signal({ ...NO_LOCAL_STATS, ...stats }) } as unknown as LocalPlayer;
}
