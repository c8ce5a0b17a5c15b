/** The viewer in a notebook's cell. The service provides the viewer, so that both have one version. */

/** How often Python gets the camera, in milliseconds. */
const CAMERA_EVERY = 200;

export default {
  async render({ model, el }) {
    const { createViewer, problem } = await load(model.get("server"));
    const view = el.appendChild(document.createElement("div"));
    const message = el.appendChild(document.createElement("p"));
    message.setAttribute("role", "status");
    message.style.margin = "0";
    const said = { invalid: "", problem: "" };
    const say = (what) => {
      Object.assign(said, what);
      const text = said.invalid || said.problem;
      if (text === message.textContent) return;
      message.textContent = text;
      model.set("error", text);
      model.save_changes();
    };
    if (problem) return void say({ problem });
    keepKeys(el);

    let viewer;
    /** The camera that Python and the viewer agree on, as JSON; undefined until the scene is loaded. */
    let agreed;
    const attempt = (act) => {
      try {
        act();
        say({ invalid: "" });
      } catch (error) {
        say({ invalid: error.message });
      }
    };
    const open = (camera) => {
      viewer?.destroy();
      viewer = agreed = undefined;
      say({ problem: "" });
      attempt(() => {
        const settings = { ...model.get("settings"), mode: model.get("mode") };
        viewer = createViewer(view, { server: model.get("server"), scene: model.get("scene"), settings, camera });
        viewer.on("error", (error) => say({ problem: error.message }));
        viewer.on("frame", () => say({ problem: "" }));
        viewer.on("loaded", () => {
          agreed = "null";
        });
      });
    };
    const change = (settings) => (viewer ? attempt(() => viewer.set(settings)) : open(model.get("_camera")));
    const report = () => {
      if (agreed === undefined) return;
      const { camera } = viewer;
      if (JSON.stringify(camera) === agreed) return;
      agreed = JSON.stringify(camera);
      model.set("_camera", camera);
      model.save_changes();
    };
    const listeners = {
      "change:scene": () => open(null),
      "change:mode": () => change({ mode: model.get("mode") }),
      "change:settings": () => change(model.get("settings")),
      "change:height": () => {
        view.style.height = `${model.get("height")}px`;
      },
      "change:_camera": () => {
        const camera = model.get("_camera");
        if (!viewer || JSON.stringify(camera) === agreed) return;
        if (camera === null) viewer.reset();
        else viewer.camera = camera;
        if (agreed !== undefined) agreed = JSON.stringify(viewer.camera);
      },
    };
    for (const [name, listener] of Object.entries(listeners)) model.on(name, listener);
    listeners["change:height"]();
    open(model.get("_camera"));
    const reporting = setInterval(report, CAMERA_EVERY);
    return () => {
      clearInterval(reporting);
      for (const [name, listener] of Object.entries(listeners)) model.off(name, listener);
      viewer?.destroy();
    };
  },
};

async function load(server) {
  try {
    return await import(`${server}/viewer/index.js`);
  } catch {
    const problem = `The viewer of ${server} cannot be loaded: this browser does not reach the service, or the service does not allow pages of ${location.origin} (setting allow_origins).`;
    return { problem };
  }
}

/** Keys in the viewer are no shortcuts of the notebook, of which JupyterLab's are bound to the document. */
function keepKeys(el) {
  el.dataset.lmSuppressShortcuts = "true";
  el.addEventListener("keydown", (event) => event.stopPropagation());
}
