/** The movement traces that the store keeps: their list, and each of them. A failure is an ApiError, or a MovementError for an invalid movement. */

import * as v from "valibot";
import { storeUnreachable } from "#client/http/obstacles";
import { ask } from "#client/http/problem";
import { ANCHORS } from "#client/wire/movement";
import type { Movement as ListedMovement } from "#client/wire/store";
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
  const { movements } = await storeAnswer(
    base,
    "movements",
    async (answer) => v.parse(List, await answer.json()),
    signal,
  );
  return movements;
}

export async function fetchMovement(base: string, name: string, signal?: AbortSignal): Promise<NamedMovement> {
  const text = await storeAnswer(base, `movements/${encodeURIComponent(name)}`, (answer) => answer.text(), signal);
  return { name, origin: "store", trace: readMovement(text, name) };
}

function storeAnswer<T>(
  base: string,
  path: string,
  read: (answer: Response) => Promise<T>,
  signal: AbortSignal | undefined,
): Promise<T> {
  const silence = () => storeUnreachable(base, location.href);
  return ask(`${base.replace(/\/+$/, "")}/${path}`, read, silence, { signal, timeout: TIMEOUT });
}
