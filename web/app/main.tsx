/** The page's entry: nothing but wiring. */
import "./styles/tokens.css";
import "./styles/base.css";
import "./styles/dashboard.css";
import "./styles/dialog.css";
import "#viewer/embed/stage.css";
import "./styles/viewer.css";
import "./styles/fields.css";
import "./styles/sidebar.css";
import "./styles/hud.css";
import "./styles/network.css";
import "./styles/movement.css";
import "./styles/comparison.css";
import "./styles/experiment.css";
import "./styles/samples.css";
import "./styles/sides.css";
import "#client/async/abort-any";
import { render } from "preact";
import { App } from "./app";
import { start } from "./state/app";

const mount = document.getElementById("app");
if (mount) {
  start();
  render(<App />, mount);
}
