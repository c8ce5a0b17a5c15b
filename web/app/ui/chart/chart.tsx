/** A chart under its caption. The drawing code is loaded with the first chart. */
import type { ComponentChildren, RefObject } from "preact";
import { useEffect, useRef } from "preact/hooks";

/** Draws into `place`, in the colours of the legend's swatches, until the function that it returns is called. */
export type Draw = (place: HTMLElement, legend: HTMLElement) => () => void;

interface Props {
  readonly name: string;
  /** Another one has it drawn anew. */
  readonly load: () => Promise<Draw>;
  /** Element with the swatches; by default the caption. */
  readonly legend?: RefObject<HTMLElement | null>;
  readonly children: ComponentChildren;
}

export function Chart({ name, load, legend, children }: Props) {
  const place = useRef<HTMLDivElement>(null);
  const caption = useRef<HTMLElement>(null);
  useEffect(() => {
    let stop: (() => void) | undefined;
    let gone = false;
    load().then(
      (draw) => {
        const swatches = (legend ?? caption).current;
        if (!gone && place.current && swatches) stop = draw(place.current, swatches);
      },
      () => undefined, // the page reports that it is outdated
    );
    return () => {
      gone = true;
      stop?.();
    };
  }, [load, legend]);
  return (
    <figure class="chart" aria-label={name}>
      <figcaption class="row wrap" ref={caption}>
        {children}
      </figcaption>
      <div class="chart-place" ref={place} />
    </figure>
  );
}
