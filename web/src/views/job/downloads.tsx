import { strings } from "../../strings";
import type { Recording } from "../../wire";

/** A job's report and files. */
export function Downloads({ href, recording }: { href: string; recording?: Recording | null }) {
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
      {recording && recording.state !== "recording" && (
        <a href={`${href}/recording`} title={recording.fault ?? recording.file} download>
          {recording.state === "complete" ? strings.job.recording : strings.job.recordingCut}
        </a>
      )}
    </p>
  );
}
