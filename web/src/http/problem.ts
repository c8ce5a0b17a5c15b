/** How a service says that it failed: problem details (RFC 9457), and one sentence to show. */
import type { Problem } from "../wire/render";

export class ApiError extends Error {
  /** The server did not answer at all. */
  readonly unreachable: boolean;

  constructor(detail: string, unreachable: boolean) {
    super(detail);
    this.name = "ApiError";
    this.unreachable = unreachable;
  }
}

/** The problem of a failed response; one is made up if the answer came from something else than our server. */
export async function readProblem(response: Response): Promise<Problem> {
  try {
    const problem = (await response.json()) as Problem;
    if (typeof problem?.detail === "string" && typeof problem.type === "string") return problem;
  } catch {
    // not JSON: a proxy's page, or nothing at all
  }
  return {
    type: "about:blank",
    title: response.statusText,
    status: response.status,
    detail: `The server answered with status ${response.status}.`,
  };
}
