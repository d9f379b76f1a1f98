import { Explained } from "../term";

/** Figures by their names. */
export function Rows({ of }: { of: [name: string, value: string, lang?: "en"][] }) {
  return (
    <dl>
      {of.map(([name, value, lang]) => (
        <div key={name}>
          <dt>
            <Explained text={name} />
          </dt>
          <dd lang={lang}>{value}</dd>
        </div>
      ))}
    </dl>
  );
}
