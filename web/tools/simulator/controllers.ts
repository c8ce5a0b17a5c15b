/**
 * Controllers for the simulator: the registry's, a fixed rung, or LoL+, L2A and Latency with other parameters.
 */
import { type ControllerFactory, FixedController } from "#client/abr/controller";
import { L2A, L2aController } from "#client/abr/l2a";
import { LatencyController, perRequest, perTransfer } from "#client/abr/latency";
import { LOLP, LolpController } from "#client/abr/lolp";
import { CONTROLLER_NAMES, CONTROLLERS, type ControllerName } from "#client/abr/registry";
import { TARGET_MS } from "#client/abr/segments";

type Parameters = Readonly<Record<string, number>>;
type Numbers<T> = { readonly [K in keyof T]: number };

interface Tunable<T extends Numbers<T> = Parameters> {
  readonly defaults: T;
  readonly create: (parameters: T) => ControllerFactory;
}

/** Checks that the factory takes the parameters that have defaults. */
function tunable<T extends Numbers<T>>(defaults: T, create: (parameters: T) => ControllerFactory): Tunable {
  return { defaults, create: (parameters) => create(parameters as T) };
}

const TUNABLE: Readonly<Record<string, Tunable>> = {
  latency: tunable(
    { target: TARGET_MS },
    ({ target }) =>
      (context) =>
        new LatencyController(context, perRequest(), target),
  ),
  "latency-transfer": tunable(
    { target: TARGET_MS },
    ({ target }) =>
      (context) =>
        new LatencyController(context, perTransfer(), target),
  ),
  "lol+": tunable({ ...LOLP }, (parameters) => (context) => new LolpController(context, parameters)),
  l2a: tunable({ ...L2A }, (parameters) => (context) => new L2aController(context, parameters)),
};

/** Throws an Error with one sentence if the controller is unknown. */
export function controllerFactory(name: string): ControllerFactory {
  if (isControllerName(name)) return CONTROLLERS[name].create;
  const [kind = "", text = ""] = name.split(/[:@]/);
  const value = Number(text);
  if (kind === "fixed" && Number.isInteger(value) && value >= 0) {
    return ({ ladder }) => new FixedController(Math.min(value, ladder.length - 1));
  }
  const entry = TUNABLE[kind];
  const parameters = entry && parse(text, entry.defaults);
  if (parameters) return entry.create(parameters);
  const others = Object.entries(TUNABLE).map(
    ([each, { defaults }]) => `${each}@${Object.keys(defaults).join("=N,")}=N`,
  );
  throw new Error(
    `"${name}" is not a controller; choose from ${[...CONTROLLER_NAMES, "fixed:RUNG", ...others].join(", ")}.`,
  );
}

/** Parses "key=number,key=number"; null if a key is unknown or a number is not positive. */
function parse(text: string, defaults: Parameters): Parameters | null {
  const pairs = text.split(",").map((pair) => pair.split("="));
  const parameters = Object.fromEntries(pairs.map(([key = "", value]) => [key, Number(value)]));
  const valid = Object.entries(parameters).every(([key, value]) => key in defaults && value > 0);
  return valid ? { ...defaults, ...parameters } : null;
}

function isControllerName(name: string): name is ControllerName {
  return name in CONTROLLERS;
}
