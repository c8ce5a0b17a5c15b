/** A browser may ask where to save a file before it reads it; in milliseconds. */
const READ_WITHIN = 60_000;

/** Hands a file to the person: the browser saves it, or asks where. */
export function save(name: string, content: Blob): void {
  const url = URL.createObjectURL(content);
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), READ_WITHIN);
}

/** Downloads a file from another server without a prompt about leaving the page. */
export function download(url: string): void {
  const frame = document.createElement("iframe");
  frame.hidden = true;
  frame.src = url;
  document.body.append(frame);
}

/** A file's name from a person's words. */
export function fileName(words: string, ending: string): string {
  return `${words.replace(/[^\p{L}\p{N}.-]+/gu, "-").replace(/^[.-]+|[.-]+$/g, "") || "experiment"}.${ending}`;
}
