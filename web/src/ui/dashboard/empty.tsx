/** What the list of scenes says when it is empty. */
import { Box, SearchX } from "lucide";
import { Icon } from "../icon";

export function NoScenes() {
  return (
    <section class="empty">
      <Icon of={Box} size={36} />
      <h2>No scenes yet</h2>
      <p>Put each scene into a folder of its own in the server's models directory, then look for new scenes.</p>
      <pre>
        <code>{`models/
  garden/
    point_cloud.ply   3D Gaussian Splatting, as INRIA's trainer writes it
    preview.jpg       optional
    scene.json        optional: name, up axis, start camera, background`}</code>
      </pre>
    </section>
  );
}

export function NoMatch({ filter }: { filter: string }) {
  return (
    <section class="empty">
      <Icon of={SearchX} size={36} />
      <h2>Nothing matches “{filter}”</h2>
      <p>Names and ids are searched for every word that you type.</p>
    </section>
  );
}
