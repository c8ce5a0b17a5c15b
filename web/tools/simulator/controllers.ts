/**
 * Controllers for the simulator: the registry's, a fixed rung, or Latency with another target.
 */
import type { ControllerFactory } from "#client/abr/controller";
import { FixedController } from "#client/abr/fixed";
import { LatencyController, perRequest, perTransfer, type ThroughputReading } from "#client/abr/latency";
import { CONTROLLER_NAMES, CONTROLLERS, type ControllerName } from "#client/abr/registry";

const READINGS: Readonly<Record<string, () => ThroughputReading>> = {
  latency: perRequest,
  "latency-transfer": perTransfer,
};

/** Throws an Error with one sentence if there is no such controller. */
export function controllerFactory(name: string): ControllerFactory {
  if (isControllerName(name)) return CONTROLLERS[name].create;
  const [kind, text] = name.split(/[:@]/);
  const value = Number(text);
  if (kind === "fixed" && Number.isInteger(value) && value >= 0) {
    return ({ ladder }) => new FixedController(Math.min(value, ladder.length - 1));
  }
  const reading = READINGS[kind ?? ""];
  if (reading && value > 0) return (context) => new LatencyController(context, reading(), value);
  const others = "fixed:RUNG, latency@MS and latency-transfer@MS";
  throw new Error(`"${name}" is no controller; there are ${CONTROLLER_NAMES.join(", ")}, ${others}.`);
}

function isControllerName(name: string): name is ControllerName {
  return name in CONTROLLERS;
}
