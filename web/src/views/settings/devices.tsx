import { useEffect, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { strings } from "../../strings";
import type { Devices as Found } from "../../daemon/wire";
import type { Given } from "../given";

/** What is connected to the daemon's machine, by the names that it can be configured with. */
export function Devices({ state, load }: Given) {
  const [found, setFound] = useState<Found | null>(null);
  const look = () =>
    load(
      api.devices().then((result) => {
        if (result.ok) setFound(result.value);
        return result;
      }),
    );
  useEffect(() => void look(), [state.bootId]);
  const words = strings.settings;
  return (
    <section class="card devices" aria-label={words.devices}>
      <h2>
        {words.devices}
        <button type="button" id="look-again" disabled={state.link !== "open"} onClick={() => void look()}>
          {words.lookAgain}
        </button>
      </h2>
      <p class="quiet">{words.devicesMore}</p>
      {found && (
        <>
          <h3>{words.cameras}</h3>
          {found.notes?.map((note) => (
            <p key={note} class="fault" lang="en">
              {note}
            </p>
          ))}
          {found.cameras.length === 0 && <p id="no-cameras">{words.noCameras}</p>}
          {found.cameras.map((camera) => (
            <Device
              key={camera.path}
              title={camera.card || camera.path}
              names={camera.names}
              more={`${camera.standard}: ${camera.unusable ?? camera.formats.join(", ")}`}
              unusable={Boolean(camera.unusable)}
            />
          ))}
          <h3>{words.ports}</h3>
          {found.serial_ports.length === 0 && <p id="no-ports">{words.noPorts}</p>}
          {found.serial_ports.map((port) => (
            <Device
              key={port.path}
              title={port.product ?? port.path}
              names={port.names}
              more=""
              unusable={false}
            />
          ))}
        </>
      )}
    </section>
  );
}

interface Props {
  title: string;
  names: string[];
  more: string;
  unusable: boolean;
}

function Device({ title, names, more, unusable }: Props) {
  return (
    <div class="device">
      <p>
        <b>{title}</b>{" "}
        {more && (
          <span class={unusable ? "fault" : "quiet"} lang={unusable ? "en" : undefined}>
            {more}
          </span>
        )}
      </p>
      {names.map((name) => (
        <code key={name}>{name}</code>
      ))}
    </div>
  );
}
