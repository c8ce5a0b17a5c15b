/** The movement traces that the store keeps: their list, and the text of each. Every failure is a MovementError. */
import * as v from "valibot";
import type { Movement as ListedMovement } from "../store-wire";
import { readProblem } from "../transport/fetch";
import { ANCHORS, MovementError } from "./movement";

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

/** The text of a movement, for `readMovement`. */
export function fetchMovement(base: string, name: string, signal?: AbortSignal): Promise<string> {
  return ask(base, `movements/${encodeURIComponent(name)}`, (answer) => answer.text(), signal);
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
    // Browsers do not tell a page that it was refused for its origin.
    throw new MovementError(`The store at ${base} does not answer as it should, or does not allow this page.`);
  }
  throw new MovementError((await readProblem(answer)).detail);
}
