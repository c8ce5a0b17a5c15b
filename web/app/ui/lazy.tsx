/** Components in separate chunks, which are loaded when they are first shown. */
import { useSignal } from "@preact/signals";
import type { ComponentType } from "preact";
import { useEffect } from "preact/hooks";

/** A component that shows a message if it cannot be loaded and, unless it is `quiet`, while it loads. */
export function lazy<Props extends object>(
  load: () => Promise<ComponentType<Props>>,
  { quiet = false } = {},
): ComponentType<Props> {
  let Loaded: ComponentType<Props> | null = null;
  return function Lazy(props: Props) {
    const failed = useSignal<boolean | null>(null);
    useEffect(() => {
      load().then(
        (component) => {
          Loaded = component;
          failed.value = false;
        },
        () => {
          failed.value = true;
        },
      );
    }, [failed]);
    const { value } = failed;
    if (Loaded) return <Loaded {...props} />;
    if (quiet && !value) return null;
    return (
      <p class="part" role="status">
        {value ? "This part of the page could not be loaded. Reload the page to try again." : "Loading…"}
      </p>
    );
  };
}
