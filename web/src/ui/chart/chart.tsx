/** A place for a chart under its caption. What draws it is loaded when the first chart is shown. */
import type { ComponentChildren, RefObject } from "preact";
import { useEffect, useRef } from "preact/hooks";

/** Draws into `place`, in the colours of the legend's swatches, until the function that it returns is called. */
export type Draw = (place: HTMLElement, legend: HTMLElement) => () => void;

interface Props {
  readonly name: string;
  /** Another one has it drawn anew. */
  readonly load: () => Promise<Draw>;
  /** Has the swatches; the caption, if it is not said. */
  readonly legend?: RefObject<HTMLElement | null>;
  /** The caption. */
  readonly children: ComponentChildren;
}

export function Chart({ name, load, legend, children }: Props) {
  const place = useRef<HTMLDivElement>(null);
  const caption = useRef<HTMLElement>(null);
  useEffect(() => {
    let stop: (() => void) | undefined;
    let gone = false;
    void load().then((draw) => {
      const swatches = (legend ?? caption).current;
      if (!gone && place.current && swatches) stop = draw(place.current, swatches);
    });
    return () => {
      gone = true;
      stop?.();
    };
  }, [load, legend]);
  return (
    <figure class="chart" aria-label={name}>
      <figcaption ref={caption}>{children}</figcaption>
      <div class="chart-place" ref={place} />
    </figure>
  );
}
