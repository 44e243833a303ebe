'use strict';
// Uploads: files and folders can be dropped on the form, the progress is shown, and a failed upload leaves the form as it was.
(() => {
  const form = document.getElementById('upload');
  if (!form) return;
  const [inputs, zone] = [[...form.querySelectorAll('input[type=file]')], form.querySelector('.drop')];
  const [bar, button] = [document.getElementById('uploaded'), form.querySelector('button[type=submit]')];
  const [problem, status] = [document.getElementById('upload-problem'), document.getElementById('dropped')];
  // Files that were dropped: file and path.
  let dropped = [];

  const files = () => {
    const chosen = inputs.flatMap((input) => [...input.files].map((file) => [file, file.webkitRelativePath || file.name]));
    return [...chosen, ...dropped];
  };

  const told = () => {
    const count = dropped.length;
    status.textContent = count > 0 ? `${count} ${count === 1 ? 'file' : 'files'} dropped here` : 'Files and folders can be dropped here.';
  };

  const read = (entry) => new Promise((resolve, reject) => {
    if (entry.isFile) entry.file((file) => resolve([[file, entry.fullPath.replace(/^\//, '')]]), reject);
    else {
      const reader = entry.createReader();
      const found = [];
      // A reader lists some entries at a time.
      const next = () => reader.readEntries((entries) => {
        if (entries.length === 0) Promise.all(found.map(read)).then((lists) => resolve(lists.flat()), reject);
        else {
          found.push(...entries);
          next();
        }
      }, reject);
      next();
    }
  });

  ['dragenter', 'dragover'].forEach((name) => zone.addEventListener(name, (event) => {
    event.preventDefault();
    zone.classList.add('over');
  }));
  zone.addEventListener('dragleave', () => zone.classList.remove('over'));
  zone.addEventListener('drop', async (event) => {
    event.preventDefault();
    zone.classList.remove('over');
    const entries = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry()).filter(Boolean);
    try {
      dropped = [...dropped, ...(await Promise.all(entries.map(read))).flat()];
    } catch (error) {
      fail(`The files cannot be read: ${error.message}`);
    }
    told();
  });

  function fail(message) {
    problem.textContent = message;
    bar.hidden = true;
    button.disabled = false;
  }

  form.addEventListener('submit', (event) => {
    event.preventDefault();
    problem.textContent = '';
    const data = new FormData();
    ['csrf', 'taken', 'name'].forEach((name) => data.append(name, form.elements[name].value));
    files().forEach(([file, path]) => data.append('file', file, path));
    const request = new XMLHttpRequest();
    request.open('POST', form.getAttribute('action'));
    request.setRequestHeader('Accept', 'application/json');
    request.upload.addEventListener('progress', ({ loaded, total, lengthComputable }) => {
      if (lengthComputable && loaded < total) bar.value = (100 * loaded) / total;
      // The service expands and hashes what it has received.
      else bar.removeAttribute('value');
    });
    request.addEventListener('load', () => {
      const place = request.getResponseHeader('Location');
      if (request.status === 201 && place) {
        location.assign(place);
        return;
      }
      try {
        fail(JSON.parse(request.responseText).detail);
      } catch {
        fail('The upload failed.');
      }
    });
    request.addEventListener('error', () => fail('The upload was interrupted.'));
    bar.value = 0;
    bar.hidden = false;
    button.disabled = true;
    request.send(data);
  });
  told();
})();
