/** The movement traces that the store keeps: their list, and each of them. Every failure is a MovementError. */

import * as v from "valibot";
import { readProblem, storeUnreachable } from "#client/http/problem";
import { ANCHORS } from "#client/wire/movement";
import type { Movement as ListedMovement } from "#client/wire/store";
import { MovementError } from "./movement";
import type { NamedMovement } from "./movement-deck";
import { readMovement } from "./movement-file";

const Listed = v.object({
  name: v.string(),
  duration_ms: v.number(),
  anchor: v.picklist(ANCHORS),
  description: v.string(),
});
const List = v.object({ movements: v.array(Listed) });

export type { ListedMovement };

const TIMEOUT = 10_000;

/** `base` is the store's URL, as `/config.json` names it. */
export async function listMovements(base: string, signal?: AbortSignal): Promise<readonly ListedMovement[]> {
  const { movements } = await ask(base, "movements", async (answer) => v.parse(List, await answer.json()), signal);
  return movements;
}

export async function fetchMovement(base: string, name: string, signal?: AbortSignal): Promise<NamedMovement> {
  const text = await ask(base, `movements/${encodeURIComponent(name)}`, (answer) => answer.text(), signal);
  return { name, origin: "store", trace: readMovement(text, name) };
}

async function ask<T>(
  base: string,
  path: string,
  read: (answer: Response) => Promise<T>,
  signal?: AbortSignal,
): Promise<T> {
  const limit = AbortSignal.timeout(TIMEOUT);
  let answer: Response;
  try {
    answer = await fetch(`${base.replace(/\/+$/, "")}/${path}`, {
      cache: "no-store",
      signal: signal ? AbortSignal.any([signal, limit]) : limit,
    });
    if (answer.ok) return await read(answer);
  } catch (error) {
    if (signal?.aborted) throw error;
    throw new MovementError(storeUnreachable(base, location.href));
  }
  throw new MovementError((await readProblem(answer)).detail);
}
