/**
 * All adaptive controllers, by their names in settings and experiments.
 *
 * To add a controller, write a class with `decide()` and `observe()` in a new file in this folder and add a line here.
 * The viewer, `npm run abr-sim` and experiments then offer it.
 */
import type { ControllerFactory } from "./controller";
import { L2aController } from "./l2a";
import { LatencyController, perRequest, perTransfer } from "./latency";
import { LolpController } from "./lolp";
import { SeenController } from "./seen";

interface Entry {
  /** Name on the page. */
  readonly title: string;
  readonly create: ControllerFactory;
}

export const CONTROLLERS = {
  seen: { title: "Seen", create: (context) => new SeenController(context) },
  latency: { title: "Latency", create: (context) => new LatencyController(context, perRequest()) },
  "latency-transfer": {
    title: "Latency (transfer)",
    create: (context) => new LatencyController(context, perTransfer()),
  },
  "lol+": { title: "LoL+", create: (context) => new LolpController(context) },
  l2a: { title: "L2A", create: (context) => new L2aController(context) },
} as const satisfies Record<string, Entry>;

export type ControllerName = keyof typeof CONTROLLERS;

export const CONTROLLER_NAMES = Object.keys(CONTROLLERS) as readonly ControllerName[];
