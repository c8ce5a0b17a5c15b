/**
 * Suppresses requests for a resting view that would not improve it: a frame of a worse rung or with narrower margins
 * shows nothing new. On a slow link it would delay other frames for seconds.
 */
import { sameView, type ViewRequest } from "./pipeline";

export class Rest<Request extends ViewRequest> {
  #last: Request | undefined;
  #chooser: unknown;

  /** The request that replaces a view whose rung `chooser` chose; choices of anything else always count. */
  view(view: Request, chooser: unknown): Request {
    const last = this.#last;
    if (last && chooser === this.#chooser && isLess(view, last)) return last;
    this.#last = view;
    this.#chooser = chooser;
    return view;
  }
}

/** Whether a request is for the same view as another, with a rung and a bit rate that are no better and margins that are no wider. */
function isLess(view: ViewRequest, than: ViewRequest): boolean {
  const { profile, overscan = 0, video, ...rest } = view;
  const { profile: best, overscan: widest = 0, video: clearest, ...same } = than;
  if (profile == null || best == null || profile < best || overscan > widest) return false;
  if ((video?.bitrate_kbps ?? 0) > (clearest?.bitrate_kbps ?? 0)) return false;
  return sameView(rest as ViewRequest, same as ViewRequest);
}
