/** The interface of everything that shows a scene on a side of the stage, and of its line in the registry. */
import type { ReadonlySignal } from "@preact/signals";
import type { Connected } from "#client/transport/connect";
import type { SessionStatus } from "#client/wire/dash";
import type { Rung, SceneInfo, ServerConfig } from "#client/wire/render";
import type { Recording } from "#client/wire/store";
import type { Enhancement } from "../enhance/enhancement";
import type { Size } from "../enhance/geometry";
import type { LocalStats } from "../local/local-player";
import type { Content, ReprojectionStatus } from "../reproject/reprojector";
import type { Settings, SideSettings } from "../state/settings";
import type { Visit } from "../stateless/stateless-player";
import type { Stats } from "../stateless/stats";
import type { StreamStats } from "../stream/stream-player";
import type { SourcePhase } from "../view/presented";

/** Figures of every source, and of its kind of delivery. */
export type SourceStats = Stats | StreamStats | LocalStats;

/** Shows the scene in one mode until it is disposed of, which removes its elements from the pane. */
export interface Source {
  readonly phase: ReadonlySignal<SourcePhase>;
  readonly stats: ReadonlySignal<SourceStats>;
  /** Whether its pictures are turned to the pose of each animation frame. */
  readonly reprojection: ReadonlySignal<ReprojectionStatus>;
  /** Null if its pictures cannot be enhanced. */
  readonly enhancement: Enhancement | null;
  /** The picture on the screen with its view and depth; null where that is unknown. */
  readonly content: Pick<Content<unknown>, "view" | "depth"> | null;
  /** A copy of the screen; null before the first picture. */
  picture(): Promise<ImageBitmap> | null;
  /** Called at the start of each animation frame: the last frame is on the screen by now. */
  presented(now: number): void;
  /** Called first in an animation frame after the page was hidden for `gap` milliseconds. */
  resumed(gap: number): void;
  /** Called once per animation frame, after the rig was sampled; `moved` is the rig's result. */
  tick(now: number, moved: boolean): void;
  /** For a recording: how the scene was delivered, with times since `startedAt`. */
  played?(startedAt: number): Partial<Pick<Recording, "dash" | "webrtc" | "local">>;
  /** The packager's report on the stream; null without one. */
  status?(signal: AbortSignal): Promise<SessionStatus | null>;
  dispose(): void;
}

/** What to show, and where. */
export interface SourceContext extends Visit {
  /** The source adds its elements to this. */
  readonly pane: HTMLElement;
  readonly settings: ReadonlySignal<SideSettings>;
  readonly scene: ReadonlySignal<SceneInfo | null>;
  readonly config: ReadonlySignal<ServerConfig | null>;
  /** The ladder that request profiles index; empty until it is known. */
  readonly ladder: ReadonlySignal<readonly Rung[]>;
  /** Null while there is no connection. */
  readonly connection: ReadonlySignal<Connected | null>;
  /** Seed of the controller's random numbers. */
  readonly seed: ReadonlySignal<number>;
  /** Screen pixels per viewport pixel; it changes when the window moves to another screen. */
  readonly pixelRatio: ReadonlySignal<number>;
  /** Displayed size of pictures, in the screen's pixels. */
  readonly size: () => Size;
}

/** A choice for one side of a comparison, if a mode has several. */
export interface Variant {
  readonly name: string;
  readonly title: string;
  readonly settings: Partial<Settings>;
}

/** A mode: its line in the registry. */
export interface SourceKind {
  readonly title: string;
  /** One sentence for the lab; absent if the settings explain it. */
  readonly about?: string;
  /** How to make it available if it is missing. */
  readonly remedy?: string;
  /** Absent if the mode itself is the only choice. */
  readonly variants?: readonly Variant[];
  /** Settings that affect it; panels of the others are hidden. */
  readonly settings: readonly (keyof Settings)[];
  /** Those among them that restart delivery, so that new frames must be awaited. */
  readonly reopens: readonly (keyof Settings)[];
  /** Whether it requests frames over the connection to the server; each side then has its own connection. */
  readonly requests: boolean;
  /** Whether this browser renders the scene itself; rungs and bit rates then do not apply. */
  readonly drawsHere: boolean;
  /** Whether it stays open while the page is hidden for long: opening it again would cost a download. */
  readonly keepsHidden: boolean;
  /** Whether its figures of the last minute are charted next to the stage, as for a comparison. */
  readonly charts: boolean;
  /** Why it is not available for a scene of this server, without a full stop; null if it is. */
  missing(server: ServerConfig | null, scene: SceneInfo): string | null;
  /** Loads its code; resolves to a function that opens the source. */
  load(): Promise<OpenSource>;
}

export type OpenSource = (context: SourceContext) => Source;
