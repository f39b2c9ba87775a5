// Communication with the server: requests, and the queue that saves every change at once.

/** An unsuccessful answer; `status` is 0 if the server does not answer. */
export class Refusal extends Error {
  constructor(status, body) {
    super(body.error || `the server answered with status ${status}`);
    this.status = status;
    this.body = body;
  }
}

/** Requests a path below the page's own address and returns the JSON of the answer. */
export async function ask(path, method = 'GET', body = undefined) {
  let response;
  try {
    response = await fetch(path, {
      method,
      headers: body === undefined ? {} : { 'Content-Type': 'application/json' },
      body: body === undefined ? undefined : JSON.stringify(body),
      cache: 'no-store',
    });
  } catch {
    throw new Refusal(0, { error: 'the server does not answer' });
  }
  const answer = await response.json().catch(() => ({}));
  if (!response.ok) throw new Refusal(response.status, answer);
  return answer;
}

export const sequencePath = (id, rest = '') => `api/sequences/${encodeURIComponent(id)}${rest}`;
export const framePath = (id, number) => sequencePath(id, `/frames/${number}`);

/** Asks only the newest question: while one is being answered, only the last of the later ones waits. */
export class Newest {
  constructor(question) {
    this.question = question;
    this.busy = false;
    this.waiting = null;
  }

  async ask(...what) {
    if (this.busy) {
      this.waiting = what;
      return;
    }
    this.busy = true;
    try {
      await this.question(...what);
    } finally {
      this.busy = false;
      const next = this.waiting;
      this.waiting = null;
      if (next) this.ask(...next);
    }
  }

  forget() {
    this.waiting = null;
  }
}

const RETRY_MS = 1500;

/** Marks that could not be sent yet, kept by the browser. */
export class Drafts {
  /** `key` distinguishes a dataset from others of the same name. */
  constructor(key) {
    this.prefix = `grimace:${key}:`;
  }

  keep(id, marks) {
    try {
      localStorage.setItem(this.prefix + id, JSON.stringify(marks));
    } catch { /* Private windows may have no storage; the page still holds the marks. */ }
  }

  drop(id) {
    try {
      localStorage.removeItem(this.prefix + id);
    } catch { /* As above. */ }
  }

  /** The sequences with such marks. */
  ids() {
    try {
      return Object.keys(localStorage).filter((key) => key.startsWith(this.prefix)).map((key) => key.slice(this.prefix.length)).sort();
    } catch {
      return [];
    }
  }

  of(id) {
    try {
      return JSON.parse(localStorage.getItem(this.prefix + id));
    } catch {
      return null;
    }
  }
}

/**
 * Saves the newest marks of each sequence, one request at a time, and repeats a request until the server answers.
 * `show(state, text)` informs the user; `conflict(id, current, marks)` asks them which marks to keep.
 */
export class Saver {
  constructor(drafts, show, conflict) {
    Object.assign(this, { drafts, show, conflict });
    this.versions = new Map();
    this.waiting = new Map();
    /** Sequences with an unsolved conflict: only the page has their marks. */
    this.held = new Set();
    this.busy = false;
  }

  /** Notes the version of a sequence that the page has read. */
  read(id, version) {
    this.versions.set(id, version);
  }

  isSent(id) {
    return !this.waiting.has(id) && this.current !== id;
  }

  isSaved(id) {
    return this.isSent(id) && !this.held.has(id);
  }

  /** Waits until everything of a sequence is saved. */
  async settled(id) {
    while (!this.isSent(id)) await new Promise((done) => setTimeout(done, 20));
  }

  save(id, marks) {
    this.held.delete(id);
    this.waiting.set(id, marks);
    this.drafts.keep(id, marks);
    this.show('saving', 'Saving…');
    this.run();
  }

  async run() {
    if (this.busy) return;
    this.busy = true;
    while (this.waiting.size) {
      const [id, marks] = this.waiting.entries().next().value;
      this.waiting.delete(id);
      this.current = id;
      try {
        const answer = await ask(sequencePath(id, '/marks'), 'PUT', { version: this.versions.get(id), marks });
        this.versions.set(id, answer.version);
        this.current = null;
        if (!this.waiting.has(id)) this.drafts.drop(id);
        if (!this.waiting.size) this.show('saved', 'Saved');
      } catch (error) {
        this.current = null;
        if (error.status === 409) {
          this.show('failed', 'Changed elsewhere');
          const latest = this.waiting.get(id) || marks;
          this.waiting.delete(id);
          await this.conflict(id, error.body.current, latest);
        } else if (error.status === 0 || error.status >= 500) {
          if (!this.waiting.has(id)) this.waiting.set(id, marks);
          this.show('failed', `Not saved: ${error.message}. Trying again…`);
          await new Promise((done) => setTimeout(done, RETRY_MS));
        } else if (error.status === 403 || error.status === 404) {
          this.show('failed', 'Not saved: the server was restarted. Open the address that it printed. Your marks are kept in this browser.');
        } else {
          this.show('failed', `Not saved: ${error.message}`);
        }
      }
    }
    this.busy = false;
  }
}
