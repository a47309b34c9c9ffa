// Where the page has its frames from: the program that serves it, or the file that it is.
import { readMessage } from './message.js';

export class HttpSource {
  async status() {
    return this.answer(await fetch('status'), (answer) => answer.json());
  }
  // Returns null where there is no such plan or frame.
  async sensor(number) {
    return this.message(`sensor?number=${number}`);
  }
  async frame(number) {
    return this.message(`frame?number=${number}`);
  }
  // Asks for a change: {set, value} or {do}. Throws with the program's sentence where it is refused.
  async change(what) {
    const body = JSON.stringify(what);
    return this.answer(await fetch('control', {method: 'POST', body}), (answer) => answer.text());
  }

  async message(path) {
    const answer = await fetch(path);
    if (answer.status === 404) return null;
    return this.answer(answer, async () => readMessage(await answer.arrayBuffer()));
  }
  async answer(answer, read) {
    if (!answer.ok) throw new Error((await answer.text()).trim());
    return read(answer);
  }
}

// Reads what the program wrote into a report: texts of base64, of bytes that zlib has packed.
export class ReportSource {
  constructor() {
    this.texts = [...document.querySelectorAll('script[data-frame]')];
  }
  async status() {
    return JSON.parse(document.getElementById('report-status').textContent);
  }
  async sensor() {
    return this.unpack(document.getElementById('report-sensor'));
  }
  async frame(number) {
    return number >= 0 && number < this.texts.length ? this.unpack(this.texts[number]) : null;
  }
  async unpack(element) {
    const bytes = Uint8Array.from(atob(element.textContent.trim()), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
    return readMessage(await new Response(stream).arrayBuffer());
  }
}
