/** Whether this browser decodes WebP as frames are: found out with a picture of one pixel. */

const ONE_PIXEL = "UklGRiIAAABXRUJQVlA4IBYAAAAwAQCdASoBAAEADsD+JaQAA3AAAAAA";

export async function decodesWebp(): Promise<boolean> {
  const bytes = Uint8Array.from(atob(ONE_PIXEL), (character) => character.charCodeAt(0));
  try {
    (await createImageBitmap(new Blob([bytes], { type: "image/webp" }))).close();
    return true;
  } catch {
    return false;
  }
}
