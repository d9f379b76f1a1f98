import { strings } from "../../strings";
import type { Recording } from "../../daemon/wire";

interface Props {
  href: string;
  recording: Recording | null | undefined;
}

/** The report and files of a job that is over. */
export function Downloads({ href, recording }: Props) {
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
      {recording?.state === "recording" && <span class="quiet">{strings.job.recordingNow}</span>}
      {recording && recording.state !== "recording" && (
        <a href={`${href}/recording`} title={recording.fault ?? recording.file} download>
          {recording.state === "complete" ? strings.job.recording : strings.job.recordingCut}
        </a>
      )}
    </p>
  );
}
