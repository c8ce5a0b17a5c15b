/** How a service says that it failed: problem details (RFC 9457), and one sentence to show. */
import type { Problem } from "../wire/render";

export class ApiError extends Error {
  /** The server did not answer at all. */
  readonly unreachable: boolean;
  /** The problem's type, such as `tigas:unknown-run`. */
  readonly type: string | undefined;

  constructor(detail: string, unreachable: boolean, type?: string) {
    super(detail);
    this.name = "ApiError";
    this.unreachable = unreachable;
    this.type = type;
  }
}

/** The problem of a failed response. */
export async function readProblem(response: Response): Promise<Problem> {
  return problemOf(response.status, await response.text().catch(() => ""));
}

/** The problem in a response's body; a generic one if another server sent it. */
export function problemOf(status: number, body: string): Problem {
  try {
    const problem = JSON.parse(body) as Problem;
    if (typeof problem?.detail === "string" && typeof problem.type === "string") return problem;
  } catch {
    // not JSON: a proxy's page, or nothing at all
  }
  return { type: "about:blank", title: "", status, detail: `The server answered with status ${status}.` };
}
