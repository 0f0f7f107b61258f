// A question before anything that moves the aircraft. What is under the finger first is No.

const dialog = document.getElementById("confirm");

/** Whether a person says yes; `yes` names what is done then. While one question is open every other is answered by no: one Yes never does two things. */
export function confirmed(question, yes) {
  if (dialog.open) return Promise.resolve(false);
  document.getElementById("confirm-text").textContent = question;
  const button = document.getElementById("confirm-yes");
  button.textContent = yes;
  dialog.returnValue = "no";
  dialog.showModal();
  document.getElementById("confirm-no").focus();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => resolve(dialog.returnValue === "yes"), { once: true });
  });
}
