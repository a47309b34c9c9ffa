// The panel that changes settings of the running program, where it may.

// Returns {"section.key": value as TOML} of a configuration.
export function settingsOf(toml) {
  const settings = {};
  let section = '';
  for (const line of toml.split('\n')) {
    const head = line.match(/^\[(\w+)\]$/);
    const pair = line.match(/^(\w+) = (.*)$/);
    if (head) section = head[1];
    else if (pair) settings[`${section}.${pair[1]}`] = pair[2];
  }
  return settings;
}

// Texts in TOML stand in quotes of either kind.
const isText = (toml) => /^["']/.test(toml);
const shownOf = (toml) => toml.replace(/^(["'])(.*)\1$/, '$2');

// Reads what the user wrote as a value of the kind that the setting has.
function valueFrom(text, toml) {
  return isText(toml) ? text : JSON.parse(text);
}

export class ControlPanel {
  constructor(source, names) {
    this.source = source;
    this.section = document.getElementById('control');
    this.answer = document.getElementById('control-answer');
    this.section.hidden = names.length === 0;
    this.inputs = new Map();
    const body = document.getElementById('control-table').createTBody();
    for (const name of names) {
      const row = body.insertRow();
      const input = document.createElement('input');
      input.setAttribute('aria-label', name);
      input.addEventListener('keydown', (event) => {
        if (event.key === 'Enter') this.change(name);
      });
      input.addEventListener('change', () => this.change(name));
      row.insertCell().textContent = name;
      row.insertCell().append(input);
      this.inputs.set(name, {input, toml: ''});
    }
    this.frames = document.getElementById('control-frames');
    for (const act of ['record', 'pause_recording', 'trigger', 'expose', 'take_dark', 'take_reference']) {
      const frames = () => (act.startsWith('take') ? {frames: Number(this.frames.value)} : {});
      document.getElementById(`control-${act}`).addEventListener('click',
        () => this.ask({do: act, ...frames()}, act.replace('_', ' ')));
    }
  }

  // Shows the values of a configuration, except where the user is writing.
  show(toml) {
    const settings = settingsOf(toml);
    for (const [name, entry] of this.inputs) {
      entry.toml = settings[name] ?? '';
      if (document.activeElement !== entry.input)
        entry.input.value = shownOf(entry.toml);
    }
  }
  async change(name) {
    const {input, toml} = this.inputs.get(name);
    if (input.value === shownOf(toml)) return;
    let value;
    try {
      value = valueFrom(input.value, toml);
    } catch {
      this.answer.textContent = `${name}: '${input.value}' is no number, true or false`;
      return;
    }
    this.inputs.get(name).toml = isText(toml) ? `"${value}"` : input.value;
    await this.ask({set: name, value}, `${name} = ${input.value}`);
  }
  async ask(what, words) {
    try {
      await this.source.change(what);
      this.answer.textContent = `${words}: done`;
    } catch (error) {
      this.answer.textContent = `${words}: ${error.message}`;
    }
  }
}
