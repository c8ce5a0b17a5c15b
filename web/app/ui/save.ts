/** Time for the browser to read a file, since it may first ask where to save it, in milliseconds. */
const READ_WITHIN = 60_000;

/** Saves a file through the browser, which may ask where. */
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

/** A valid file name made from any text. */
export function fileName(words: string, ending: string): string {
  return `${words.replace(/[^\p{L}\p{N}.-]+/gu, "-").replace(/^[.-]+|[.-]+$/g, "") || "experiment"}.${ending}`;
}
