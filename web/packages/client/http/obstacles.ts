/** Why browsers keep a page from a service, in one sentence. Pure. */
import { mixedContent } from "./problem";

/** Why a page at `page` cannot talk to a shaper at `base`, in one sentence; null if it can. */
export function shaperObstacle(base: string, page: string): string | null {
  if (!URL.canParse(base)) return `The shaper's address is not a URL: ${base}.`;
  if (!mixedContent(base, page)) return null;
  return "Browsers do not let a secure page use a shaper over plain HTTP: open this page over http:// to change the link.";
}

/** Why a page at `page` gets no answer from the store at `base`, in one sentence. */
export function storeUnreachable(base: string, page: string): string {
  if (URL.canParse(base) && mixedContent(base, page)) {
    return "Browsers do not let a secure page use a store over plain HTTP: open this page over http:// to use it.";
  }
  // Browsers do not report a refusal because of the origin.
  return `The store at ${base} is not responding as expected, or does not allow this page.`;
}
