/** Placeholders for an empty list of scenes. */
import { Box, SearchX } from "lucide";
import { Icon } from "../button";

export function NoScenes({ editable }: { editable: boolean }) {
  return (
    <section class="empty stack">
      <Icon of={Box} size={36} />
      <h2>No scenes yet</h2>
      <p>
        {editable ? "Drop scene files here, or put them " : "Put scene files "}into the server's models directory and
        rescan the folder.
      </p>
      <pre>
        <code>{`models/
  kitchen.spz         3D Gaussian Splatting: PLY, compressed PLY, SOG, SPZ or .splat
  garden/             a folder can hold more
    point_cloud.ply
    preview.jpg       optional
    scene.json        optional: name, up axis, start camera, background`}</code>
      </pre>
    </section>
  );
}

export function NoMatch({ filter }: { filter: string }) {
  return (
    <section class="empty stack">
      <Icon of={SearchX} size={36} />
      <h2>No scenes match “{filter}”</h2>
      <p>A scene's name or id must contain every word you type.</p>
    </section>
  );
}
