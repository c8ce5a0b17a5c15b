/** Entry point of the page: only wiring. */
import "./styles/tokens.css";
import "./styles/base.css";
import "./styles/dashboard.css";
import "#viewer/embed/stage.css";
import "./styles/viewer.css";
import "./styles/figures.css";
import "./styles/lab.css";
import "./styles/experiment.css";
import { render } from "preact";
import { App } from "./app";
import { start } from "./state/app";

const mount = document.getElementById("app");
if (mount) {
  start();
  render(<App />, mount);
}
