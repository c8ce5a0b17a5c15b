/** Hands a file to the person: the browser saves it, or asks where. */
export function save(name: string, content: Blob): void {
  const url = URL.createObjectURL(content);
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  URL.revokeObjectURL(url);
}

/** A file's name from a person's words. */
export function fileName(words: string, ending: string): string {
  return `${words.replace(/[^\p{L}\p{N}.-]+/gu, "-").replace(/^[.-]+|[.-]+$/g, "") || "experiment"}.${ending}`;
}
