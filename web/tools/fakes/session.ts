/** A visit for tests of its views: no connection, all state set by the test. */
import { computed, type Signal, signal } from "@preact/signals";
import type { Connected } from "#client/transport/connect";
import type { ConnectionState } from "#client/transport/connection";
import type { SceneInfo } from "#client/wire/render";
import type { WalkedSide } from "#viewer/charts/walk";
import type { Enhancement, EnhancementStatus } from "#viewer/enhance/enhancement";
import { type LocalStats, NO_LOCAL_STATS } from "#viewer/local/local-player";
import { MovementDeck } from "#viewer/movement/movement-deck";
import { type ReprojectionStatus, reprojectionNote } from "#viewer/reproject/reprojector";
import type { Comparison } from "#viewer/session/comparison";
import type { Phase, ViewerSession } from "#viewer/session/session";
import { SOURCES } from "#viewer/sources/registry";
import { settingsAt } from "#viewer/sources/sides";
import type { Source, SourceStats } from "#viewer/sources/source";
import type { Place } from "#viewer/state/settings";
import { NO_STATS, type Stats } from "#viewer/stateless/stats";
import { NO_STREAM_STATS, type StreamStats } from "#viewer/stream/stream-player";
import { Presence } from "#viewer/view/presence";
import type { SourcePhase } from "#viewer/view/presented";
import { page, settings } from "../../app/state/app";
import { STILL, steeredRig } from "./rig";
import { COURTYARD } from "./server";

/** The result of a walk on one side. */
export const WALKED_SIDE: WalkedSide = {
  inputs: 600,
  contentAge: 60,
  latency: { p50: 48, p95: 96 },
  newViewsPerSecond: 47.6,
  bandwidth: 10_200_000,
  bytes: 15_700_000,
  stalled: 0,
};

/** A source without a picture, with its state for the test to set. */
export interface FakeSource<Of extends SourceStats = SourceStats> extends Source {
  readonly phase: Signal<SourcePhase>;
  readonly stats: Signal<Of>;
  readonly reprojection: Signal<ReprojectionStatus>;
}

function fakeSource<Of extends SourceStats>(phase: SourcePhase, stats: Of): FakeSource<Of> {
  return {
    phase: signal(phase),
    stats: signal(stats),
    reprojection: signal("on"),
    enhancement: null,
    content: null,
    picture: () => null,
    presented: () => undefined,
    resumed: () => undefined,
    tick: () => undefined,
    dispose: () => undefined,
  };
}

/** Single pictures, with an enhancement that only counts how often it is renewed. */
export function fakePictures(stats: Partial<Stats> = {}) {
  const status = signal<EnhancementStatus>({ kind: "off" });
  const enhancement = {
    status,
    renewals: 0,
    renew: () => {
      enhancement.renewals++;
    },
  };
  const source = fakeSource({ kind: "playing" }, { ...NO_STATS, ...stats });
  return { ...source, enhancement: enhancement as typeof enhancement & Enhancement };
}

export const fakeStream = (phase: SourcePhase, stats: Partial<StreamStats> = {}) =>
  fakeSource<StreamStats>(phase, { ...NO_STREAM_STATS, ...stats });

export const fakeLocal = (phase: SourcePhase, stats: Partial<LocalStats> = {}) =>
  fakeSource<LocalStats>(phase, { ...NO_LOCAL_STATS, ...stats });

export function fakeSide(place: Place, first: Source = fakePictures()) {
  const source = signal<Source | null>(first);
  const own = computed(() => settingsAt(place, settings.value));
  return {
    settings: own,
    kind: computed(() => SOURCES[own.value.mode]),
    source,
    missing: signal<string | null>(null),
    unturned: computed((): string | null => reprojectionNote(source.value?.reprojection.value ?? "off")),
    get figures(): SourceStats | null {
      return source.value?.stats.value ?? null;
    },
    picture: () => null,
    onPresented: () => () => undefined,
  };
}

type FakeSide = ReturnType<typeof fakeSide>;

/** In the scene, playing. */
export function fakeSession() {
  const rig = steeredRig(() => fake.axes);
  rig.resize(1280, 720);
  const pictures = fakePictures();
  const left = fakeSide("left", pictures);
  const right = signal<FakeSide | null>(null);
  const fake = {
    /** The input that the rig samples. */
    axes: STILL,
    phase: signal<Phase>({ kind: "playing" }),
    state: page,
    presence: new Presence(),
    scene: signal<SceneInfo | null>(COURTYARD),
    connected: signal<Connected | null>(null),
    silent: signal(false),
    rig,
    stage: { element: new EventTarget() },
    movement: new MovementDeck(rig),
    left,
    right,
    /** The first source of the left side. */
    pictures,
    source: left.source,
    sources: computed(() => [left, right.value].flatMap((side) => side?.source.value ?? [])),
    comparison: signal<Comparison | null>(null),
    rightConnection: signal<ConnectionState | null>(null),
    unturned: computed(() => left.unturned.value ?? right.value?.unturned.value ?? null),
    seed: signal(1),
    input: { pad: { forward: 0, right: 0, up: 0 } },
    receivedBytes: 0,
    retries: 0,
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
