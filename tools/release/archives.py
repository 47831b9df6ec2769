"""Archives of a release: the same bytes whenever and wherever they are made of the same files. Used by tools/release.sh.

    archives.py wheel IN.whl FOLDER_OF_PROGRAMS OUT.whl LICENCE...   adds programs, which pip puts on the path, and licences
    archives.py zip FOLDER OUT.zip EXCLUDED...                       all files of a folder but those that a pattern names
    archives.py tar FOLDER OUT.tar.gz                                a folder, with its own name before its files
"""

import base64
import fnmatch
import gzip
import hashlib
import io
import os
import sys
import tarfile
import time
import zipfile
from pathlib import Path

EPOCH = int(os.environ.get("SOURCE_DATE_EPOCH", "315532800"))


def add(archive, name, data, executable=False):
    """A file in a ZIP archive, without owner, with the release's date."""
    info = zipfile.ZipInfo(name, time.gmtime(EPOCH)[:6])
    info.compress_type = zipfile.ZIP_DEFLATED
    info.create_system = 3
    info.external_attr = (0o100755 if executable else 0o100644) << 16
    archive.writestr(info, data, compresslevel=9)


def wheel(source, programs, target, licences):
    """Files of a wheel as the wheel format (PyPA, binary distribution format 1.0) has them: programs below NAME.data/scripts."""
    with zipfile.ZipFile(source) as archive:
        files = {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}
    record = next(name for name in files if name.endswith(".dist-info/RECORD"))
    information = record.rsplit("/", 1)[0]
    data = information.removesuffix(".dist-info") + ".data"
    del files[record]
    # The list of dependencies names the folder of the sources.
    for name in files:
        if name.startswith(f"{information}/sboms/"):
            files[name] = files[name].replace(str(Path.cwd()).encode(), b"/ltm")
    scripts = set()
    for program in sorted(Path(programs).iterdir()):
        scripts.add(f"{data}/scripts/{program.name}")
        files[f"{data}/scripts/{program.name}"] = program.read_bytes()
    for licence in licences:
        files[f"{information}/licenses/{Path(licence).name}"] = Path(licence).read_bytes()
    lines = []
    with zipfile.ZipFile(target, "w") as archive:
        # What describes the wheel stands last, as the format recommends.
        for name in sorted(files, key=lambda name: (name.startswith(information), name)):
            digest = base64.urlsafe_b64encode(hashlib.sha256(files[name]).digest()).rstrip(b"=").decode()
            quoted = f'"{name}"' if "," in name else name
            lines.append(f"{quoted},sha256={digest},{len(files[name])}\n")
            add(archive, name, files[name], name in scripts or name.endswith(".so"))
        lines.append(f"{record},,\n")
        add(archive, record, "".join(lines))


def zip_folder(folder, target, excluded):
    def is_left_out(path):
        relative = "/" + path.relative_to(folder).as_posix()
        return any(fnmatch.fnmatch(relative, pattern) for pattern in excluded)

    files = sorted(path for path in Path(folder).rglob("*") if path.is_file() and not is_left_out(path))
    with zipfile.ZipFile(target, "w") as archive:
        for path in files:
            add(archive, path.relative_to(folder).as_posix(), path.read_bytes())


def tar_folder(folder, target):
    folder = Path(folder)
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for path in sorted(path for path in folder.rglob("*") if path.is_file()):
            info = archive.gettarinfo(path, f"{folder.name}/{path.relative_to(folder).as_posix()}")
            info.uid = info.gid = 0
            info.uname = info.gname = ""
            info.mtime = EPOCH
            info.mode = 0o755 if path.stat().st_mode & 0o100 else 0o644
            with path.open("rb") as file:
                archive.addfile(info, file)
    with open(target, "wb") as file, gzip.GzipFile("", "wb", 9, file, mtime=EPOCH) as compressed:
        compressed.write(packed.getvalue())


if __name__ == "__main__":
    action, arguments = sys.argv[1], sys.argv[2:]
    if action == "wheel":
        wheel(*arguments[:3], arguments[3:])
    elif action == "zip":
        zip_folder(arguments[0], arguments[1], arguments[2:])
    elif action == "tar":
        tar_folder(*arguments)
    else:
        sys.exit(__doc__)
