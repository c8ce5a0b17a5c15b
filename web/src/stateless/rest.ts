/**
 * While the view rests, it is asked for anew only to see more of it: a frame of a worse rung, or with narrower margins, shows nothing
 * that the one before does not. On a slow link it would keep others from coming for seconds.
 */
import { sameView, type ViewRequest } from "./pipeline";

export class Rest<Request extends ViewRequest> {
  #last: Request | undefined;
  #chooser: unknown;

  /** What to ask for instead of a view, whose rung `chooser` chose: another one's choice counts in any case. */
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
