import { Explained } from "../term";

/** Figures by their names. */
export function Rows({ of }: { of: [name: string, value: string][] }) {
  return (
    <dl>
      {of.map(([name, value]) => (
        <div key={name}>
          <dt>
            <Explained text={name} />
          </dt>
          <dd>{value}</dd>
        </div>
      ))}
    </dl>
  );
}
