/** Panels of the lab: mode, quality, transport, the shaped link if there is one, movement and lens. */
import type { ComponentChildren } from "preact";
import type { Rung } from "#client/wire/render";
import type { ViewerSession } from "#viewer/session/session";
import { applies } from "#viewer/sources/sides";
import { DEFAULT_SETTINGS, SETTINGS, type Settings } from "#viewer/state/settings";
import type { Intrinsics } from "#viewer/view/intrinsics";
import { changeSettings, config, ladder, settings } from "../../state/app";
import { QuietButton } from "../button";
import { NumberField, RadioList } from "../fields";
import { bytes } from "../format";
import { NetworkPanel } from "../network/network-panel";
import { InsecureHint } from "../notice";
import { CameraPaths } from "./camera-paths";
import { EnhancementPanel } from "./enhancement-panel";
import { ModePanel } from "./mode-panel";
import { MovementTrace } from "./movement-trace";
import { ReprojectionPanel } from "./reprojection-panel";
import { SaveVideo } from "./save-video";
import { SavedViews, StartView } from "./saved-views";
import { Choice, NumberSetting, Toggle } from "./setting";

interface Props {
  readonly session: ViewerSession;
  readonly onReset: () => void;
}

export function Panels({ session, onReset }: Props) {
  const shaper = config.value?.services.shaper;
  const movement = session.movement.movement.value;
  const affects = (name: keyof Settings) => applies(name, settings.value);
  return (
    <>
      <Section title="Mode">
        <ModePanel session={session} />
      </Section>
      {affects("controller") && <Quality session={session} />}
      {affects("upscale") && (
        <Section title="Enhancement">
          <EnhancementPanel session={session} />
        </Section>
      )}
      {affects("reprojection") && (
        <Section title="Reprojection">
          <ReprojectionPanel session={session} />
        </Section>
      )}
      {affects("transport") && (
        <Section title="Transport">
          <Choice name="transport" bare />
          <InsecureHint />
        </Section>
      )}
      {shaper && (
        <Section title="Network">
          <NetworkPanel base={shaper} session={session} />
        </Section>
      )}
      <Movement session={session} onReset={onReset} />
      <Section title="Views">
        <SavedViews session={session} />
        <StartView session={session} />
      </Section>
      <Section title="Camera paths">
        <CameraPaths session={session} />
      </Section>
      <Section title="Movement trace">
        <MovementTrace deck={session.movement} scene={session.scene.value} />
        {movement && session.scene.value && (
          <SaveVideo session={session} of="movement" name={movement.name} path={() => session.movement.path} />
        )}
      </Section>
      <Lens session={session} />
    </>
  );
}

interface SectionProps {
  readonly title: string;
  readonly action?: ComponentChildren;
  readonly children: ComponentChildren;
}

function Section({ title, action, children }: SectionProps) {
  return (
    <section class="stack">
      <div class="section-head row spread">
        <h3 class="muted small">{title}</h3>
        {action}
      </div>
      {children}
    </section>
  );
}

function Quality({ session }: { session: ViewerSession }) {
  const { controller, profile } = settings.value;
  const stats = session.source.value?.stats.value;
  const frame = stats?.kind === "requests" ? stats.frame : null;
  const adapts = controller !== "fixed";
  const chosen = adapts ? frame?.profile : Math.min(profile, Math.max(0, ladder.value.length - 1));
  return (
    <Section title="Quality">
      <Choice
        name="controller"
        bare
        options={Object.entries(SETTINGS.controller.options).map(([name, title]) => [
          name,
          name === DEFAULT_SETTINGS.controller ? "Automatic (recommended)" : title,
        ])}
      />
      <RadioList
        name="profile"
        label="Profile"
        disabled={adapts}
        rows={ladder.value.map((rung, i) => ({ key: String(i), title: rung.name, detail: detail(rung) }))}
        chosen={String(chosen)}
        onChoose={(key) => changeSettings({ profile: Number(key) })}
      />
      <Toggle name="refine" />
      <Toggle name="webp" />
      <p class="row spread small muted">
        <span>Resolution</span>
        <output>{frame?.width && frame.height ? `${frame.width} × ${frame.height}` : "–"}</output>
      </p>
    </Section>
  );
}

/** Explains a rung's name: rungs of a scene's own ladder are named after size and quality. */
function detail({ name, width, height, quality, expected_kb }: Rung): string {
  if (!name.startsWith(`${width}×${height} `)) return `${width} × ${height} · q${quality}`;
  return `about ${bytes(1000 * expected_kb)}`;
}

function Movement({ session, onReset }: Props) {
  const { moveSpeed } = session.rig;
  return (
    <Section title="Movement" action={<QuietButton onClick={onReset}>Reset camera</QuietButton>}>
      <Choice name="drag" />
      <div class="fields">
        <NumberSetting name="turnSpeed" />
        <NumberField
          label="Move"
          unit="units/s"
          min={0.001}
          max={1e6}
          value={moveSpeed.value}
          onValue={(speed) => {
            moveSpeed.value = speed;
          }}
        />
      </div>
    </Section>
  );
}

function Lens({ session }: { session: ViewerSession }) {
  const { intrinsics, lens, viewport } = session.rig;
  const locked = Object.keys(lens.value).length > 0;
  const set = (name: keyof Intrinsics, value: number) => {
    lens.value = { ...lens.value, [name]: value };
  };
  const { width, height } = viewport.value;
  return (
    <Section
      title="Lens"
      action={
        <QuietButton
          disabled={!locked}
          onClick={() => {
            lens.value = {};
          }}
        >
          Reset lens
        </QuietButton>
      }
    >
      <div class="fields">
        {(["fx", "fy", "cx", "cy"] as const).map((name) => (
          <NumberField
            key={name}
            label={name}
            unit="px"
            min={name.startsWith("f") ? 1 : -1e5}
            max={1e5}
            value={intrinsics.value[name]}
            locked={name in lens.value}
            onValue={(value) => set(name, value)}
          />
        ))}
      </div>
      <p class="muted small">
        For a view of {width} × {height} pixels. {locked ? "Your values are kept when the window is resized." : ""}
      </p>
    </Section>
  );
}
