import { strings } from "../../strings";

/** A job's report and files. */
export function Downloads({ href }: { href: string }) {
  return (
    <p class="downloads">
      <a href={`${href}/report.html`} target="_blank" rel="noopener">
        {strings.job.report}
      </a>
      <a href={`${href}/export.csv`} download>
        {strings.job.csv}
      </a>
      <a href={`${href}/export.json`} download>
        {strings.job.json}
      </a>
    </p>
  );
}
