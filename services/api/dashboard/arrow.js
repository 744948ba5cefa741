// Arrow streams of float32 and int32 columns without empty values, as the server sends them for plots.
// Format: arrow.apache.org/docs/format/Columnar.html (encapsulated messages), flatbuffers.dev (tables).

const SCHEMA = 1, BATCH = 3, FLOAT = 3;

// A flatbuffers table: its fields by position; a field that is missing is 0.
class Table {
  constructor(view, at) {
    this.view = view;
    this.at = at;
    this.fields = at - view.getInt32(at, true);
    this.count = (view.getUint16(this.fields, true) - 4) / 2;
  }

  place(field) {
    const offset = field < this.count ? this.view.getUint16(this.fields + 4 + 2 * field, true) : 0;
    return offset ? this.at + offset : 0;
  }

  byte(field) { const at = this.place(field); return at ? this.view.getUint8(at) : 0; }
  long(field) { const at = this.place(field); return at ? Number(this.view.getBigInt64(at, true)) : 0; }
  inner(field) { const at = this.place(field); return at + this.view.getUint32(at, true); }
  table(field) { return new Table(this.view, this.inner(field)); }
  size(field) { return this.place(field) ? this.view.getUint32(this.inner(field), true) : 0; }
  tables(field) {
    const first = this.inner(field) + 4;
    return Array.from({ length: this.size(field) }, (_, k) => new Table(this.view, first + 4 * k + this.view.getUint32(first + 4 * k, true)));
  }
  text(field) {
    const at = this.inner(field);
    return new TextDecoder().decode(new Uint8Array(this.view.buffer, at + 4, this.view.getUint32(at, true)));
  }
}

// Return { metadata, rows, columns: { name: Float32Array | Int32Array } }; the columns share the buffer's memory.
export function readArrow(buffer) {
  const view = new DataView(buffer);
  const answer = { metadata: {}, rows: 0, columns: {} };
  let fields = [];
  let at = 0;
  while (at + 8 <= buffer.byteLength) {
    const length = view.getInt32(at + 4, true);
    if (length === 0) break;
    const start = at + 8;
    const message = new Table(view, start + view.getUint32(start, true));
    const body = start + length;
    const header = message.table(2);
    if (message.byte(1) === SCHEMA) {
      fields = header.tables(1).map((field) => ({ name: field.text(0), kind: field.byte(2) === FLOAT ? Float32Array : Int32Array }));
      for (const one of header.size(2) ? header.tables(2) : []) answer.metadata[one.text(0)] = one.text(1);
    } else if (message.byte(1) === BATCH) {
      answer.rows = header.long(0);
      const buffers = header.inner(2) + 4;
      // Two buffers a column: which values are empty (none), and the values.
      fields.forEach(({ name, kind }, k) => {
        const offset = Number(view.getBigInt64(buffers + 16 * (2 * k + 1), true));
        answer.columns[name] = new kind(buffer, body + offset, answer.rows);
      });
    }
    at = body + message.long(3);
  }
  for (const { name, kind } of fields) answer.columns[name] ??= new kind(0);
  return answer;
}
