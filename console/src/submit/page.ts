// Submission: a file, what it holds on a map, the form, what it will cost, and off it goes.

import "../style/map.css";
import "../style/submit.css";
import "ol/ol.css";

import { make, write } from "../kit/element";
import { dropZone } from "../kit/drop";
import { counted } from "../kit/format";
import { notice, problemNotice, say } from "../kit/notice";
import { href } from "../route/address";
import { type Page, heading } from "../route/router";
import { type Abilities, abilities } from "../service/abilities";
import { isAbort, Problem } from "../service/problem";
import type { Job } from "../service/types";
import { type Form, jobForm } from "./form";
import { Forecast } from "./forecast";
import { Preview } from "./preview";
import { Reader, type Summary } from "./reader";
import { jobShipment, recordingShipment } from "./send";

const READ_THERE =
  "The dashed line is the lattice that the service would lay over the recording, the points are what it read there.";

export function submitPage(): Page {
  const over = new AbortController();
  const page = new SubmitPage(over.signal);
  return { title: "Submit", element: page.element, leave: () => over.abort() };
}

class SubmitPage {
  private readonly reader = new Reader();
  private readonly preview: Preview;
  private readonly stage = make("div", { class: "submit-stage" });
  private readonly trouble = make("div", {});
  private readonly state = make("p", { role: "status", class: "note" });
  readonly element: HTMLElement;
  private able: Abilities | null = null;

  constructor(private readonly signal: AbortSignal) {
    this.preview = new Preview(signal);
    signal.addEventListener("abort", () => this.reader.dispose());
    this.element = make(
      "div",
      { class: "page" },
      heading("Submit scans"),
      dropZone(
        ".json,.log,.clf,.txt,.gz,.mcap",
        [
          "A job as JSON, a CARMEN log (FLASER lines), an MCAP recording; JSON and logs may be gzipped.",
          ["From a terminal: ", make("code", {}, `mapfit submit FILE --wait --url ${location.origin}`)],
        ],
        (file) => void this.take(file),
        signal,
      ),
      this.state,
      this.trouble,
      this.stage,
    );
  }

  private async take(file: File): Promise<void> {
    this.trouble.replaceChildren();
    this.stage.replaceChildren();
    write(this.state, `Reading ${file.name}…`);
    try {
      const [summary, able] = await Promise.all([this.reader.read(file), abilities().catch(() => null)]);
      this.able = able;
      if (summary.kind === "recording" && !able?.reads("post", "/v1/jobs", "multipart/form-data")) {
        throw new Error(
          "This service does not read MCAP recordings in its version. Send a job as JSON, or a CARMEN log.",
        );
      }
      write(this.state, "");
      this.open(file, summary);
    } catch (error) {
      write(this.state, "");
      this.trouble.replaceChildren(
        notice({ title: `${file.name} cannot be sent`, detail: (error as Error).message, role: "alert" }),
      );
    }
  }

  private open(file: File, summary: Summary): void {
    const recording = summary.kind === "recording";
    const what = make("p", { class: "what" });
    const describe = ({ scans, of, returns }: Summary) =>
      write(
        what,
        recording
          ? `${file.name}: a recording, which the service reads.`
          : `${file.name}: ${counted(scans, "scan")}${scans < of ? ` of ${of}` : ""}, ${counted(returns.points.length / 2, "return")}`,
      );
    describe(summary);
    const pack = async () => (recording ? recordingShipment(file, form) : jobShipment(this.reader, form));
    const forecast = new Forecast(pack, this.able, this.signal, {
      lattice: (lattice) => {
        this.preview.showLattice(lattice);
        if (lattice) this.stage.classList.remove("alone");
      },
      estimate: ({ scans = 0, returns, preview }) => {
        if (recording) write(what, `${file.name}: ${counted(scans, "scan")}, ${counted(returns, "return")}`);
        if (preview) this.preview.showRead(preview);
      },
    });
    const changed = async (selection: boolean) => {
      if (selection && !recording) {
        summary = await this.reader.select(form.selection());
        describe(summary);
        this.preview.show(summary, false);
      }
      forecast.ask(summary, form.settings());
    };
    const form = jobForm(summary, file.name, (selection) => void changed(selection));
    // A repeat after a lost answer is the same submission; after a change it is another.
    let idempotency = newKey();
    form.element.addEventListener("input", () => (idempotency = newKey()));
    const outcome = make("div", {});
    const button = make("button", { type: "submit", class: "primary" }, "Submit");
    const submit = async (event: Event) => {
      event.preventDefault();
      button.disabled = true;
      write(button, "Sending…");
      try {
        this.sent(await (await pack()).send(idempotency));
      } catch (error) {
        if (!isAbort(error)) this.refused(error, form, outcome);
      }
      button.disabled = false;
      write(button, "Submit");
    };
    const controls = make(
      "form",
      { onsubmit: (event: Event) => void submit(event), class: "submit-form" },
      what,
      form.element,
      forecast.element,
      outcome,
      make("p", { class: "actions" }, button),
    );
    this.stage.replaceChildren(controls, this.preview.element);
    // Beside a recording there is nothing to see until the service has said what its lattice will be.
    this.stage.classList.toggle("alone", recording);
    this.preview.clear(summary, recording ? READ_THERE : null);
    if (!recording) this.preview.show(summary, true);
    forecast.ask(summary, form.settings());
    form.element.querySelector("input")?.focus();
  }

  private sent(job: Job): void {
    say("Submitted");
    location.hash = href(["jobs", job.id]);
  }

  private refused(error: unknown, form: Form, outcome: HTMLElement): void {
    const problem = Problem.of(error);
    const left = form.faults(problem.errors);
    const rest = new Problem(
      problem.status,
      problem.title,
      left.length === problem.errors.length ? problem.detail : "",
      left,
      problem.slug,
    );
    outcome.replaceChildren(problemNotice(rest));
  }
}

/** A name that no other submission has. Not `crypto.randomUUID`: a page that came by plain HTTP does without it. */
function newKey(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}
