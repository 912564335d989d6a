#include "tests/support/faulty_vfs.hpp"

#include <fcntl.h>
#include <sqlite3.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <fstream>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

namespace tacho::test {

namespace fs = std::filesystem;

namespace {

constexpr std::uint64_t kSector = 512;

/// One change of a file that a sync has not made durable yet.
struct Change {
  std::uint64_t offset = 0;
  std::string bytes;
  bool truncate = false;  ///< to `offset`

  void apply_to(std::string& content) const { apply_to(content, 0, bytes.size()); }
  /// Bytes from .. to - 1 of the write only.
  void apply_to(std::string& content, std::size_t from, std::size_t to) const {
    if (truncate) {
      content.resize(std::min<std::size_t>(content.size(), offset));
    } else if (from < to) {
      content.resize(std::max<std::size_t>(content.size(), offset + to));
      std::copy(bytes.begin() + static_cast<std::ptrdiff_t>(from), bytes.begin() + static_cast<std::ptrdiff_t>(to),
                content.begin() + static_cast<std::ptrdiff_t>(offset + from));
    }
  }
};

struct FileState {
  std::string durable;
  std::vector<Change> pending;
};

using FileId = std::size_t;
using Names = std::map<std::string, FileId>;

/// A name that came, went, or became another one.
struct NameChange {
  std::string gone;
  std::string made;
  FileId file = 0;

  void apply_to(Names& names) const {
    if (!gone.empty()) {
      names.erase(gone);
    }
    if (!made.empty()) {
      names[made] = file;
    }
  }
};

std::string read_all(const fs::path& path) {
  std::string content(fs::file_size(path), '\0');
  std::ifstream(path, std::ios::binary).read(content.data(), static_cast<std::streamsize>(content.size()));
  return content;
}

}  // namespace

struct FaultyDisk::Impl {
  fs::path folder;
  std::vector<FileState> files;
  Names names;  // as programs see them
  Names durable_names;
  std::vector<NameChange> pending_names;
  bool folder_durable = true;
  std::function<void(Call)> hook;
  std::uint64_t calls = 0;
  std::optional<Fault> fault;
  bool struck = false;
  std::optional<std::uint64_t> capacity;
  sqlite3_vfs vfs{};
  sqlite3_vfs* real = nullptr;

  [[nodiscard]] bool mine(const char* path) const { return path != nullptr && fs::path(path).parent_path() == folder; }
  FileId file(const std::string& name, bool existed);
  void rename(const std::string& from, const std::string& to);
  void remove(const std::string& name);
  void folder_synced();
  bool fails(Call call);
  [[nodiscard]] std::uint64_t used() const;
  [[nodiscard]] int fault_errno() const { return fault->kind == FaultKind::io_error ? EIO : ENOSPC; }
};

namespace {

FaultyDisk::Impl* g_disk = nullptr;

/// What SQLite allocates for a file; the real file follows.
struct ShimFile {
  sqlite3_file base;
  bool mine;
  FileId id;
};
constexpr int kShimBytes = (sizeof(ShimFile) + 15) / 16 * 16;

ShimFile* shim(sqlite3_file* file) { return reinterpret_cast<ShimFile*>(file); }
sqlite3_file* real(sqlite3_file* file) {
  return reinterpret_cast<sqlite3_file*>(reinterpret_cast<char*>(file) + kShimBytes);
}
FileState* state_of(sqlite3_file* file) { return shim(file)->mine ? &g_disk->files[shim(file)->id] : nullptr; }

int shim_close(sqlite3_file* file) { return real(file)->pMethods->xClose(real(file)); }

int shim_read(sqlite3_file* file, void* to, int size, sqlite3_int64 offset) {
  return real(file)->pMethods->xRead(real(file), to, size, offset);
}

int write_part(sqlite3_file* file, FileState& state, std::string bytes, sqlite3_int64 offset) {
  const int code = real(file)->pMethods->xWrite(real(file), bytes.data(), static_cast<int>(bytes.size()), offset);
  if (code == SQLITE_OK) {
    state.pending.push_back({static_cast<std::uint64_t>(offset), std::move(bytes), false});
  }
  return code;
}

int shim_write(sqlite3_file* file, const void* from, int size, sqlite3_int64 offset) {
  FileState* state = state_of(file);
  if (state == nullptr) {
    return real(file)->pMethods->xWrite(real(file), from, size, offset);
  }
  std::string bytes(static_cast<const char*>(from), static_cast<std::size_t>(size));
  if (g_disk->fails(Call::write)) {
    if (g_disk->fault->kind == FaultKind::short_write) {
      bytes.resize(bytes.size() / 2);
      write_part(file, *state, bytes, offset);
    }
    return g_disk->fault->kind == FaultKind::io_error ? SQLITE_IOERR_WRITE : SQLITE_FULL;
  }
  sqlite3_int64 end = 0;
  real(file)->pMethods->xFileSize(real(file), &end);
  if (g_disk->capacity && offset + size > end &&
      g_disk->used() + static_cast<std::uint64_t>(offset + size - end) > *g_disk->capacity) {
    return SQLITE_FULL;
  }
  return write_part(file, *state, std::move(bytes), offset);
}

int shim_truncate(sqlite3_file* file, sqlite3_int64 size) {
  FileState* state = state_of(file);
  if (state != nullptr) {
    if (g_disk->fails(Call::truncate)) {
      return SQLITE_IOERR_TRUNCATE;
    }
    state->pending.push_back({static_cast<std::uint64_t>(size), {}, true});
  }
  return real(file)->pMethods->xTruncate(real(file), size);
}

int shim_sync(sqlite3_file* file, int flags) {
  FileState* state = state_of(file);
  if (state != nullptr && g_disk->fails(Call::sync)) {
    return SQLITE_IOERR_FSYNC;
  }
  // Also syncs the folder after a journal or WAL was created, through our fsync().
  const int code = real(file)->pMethods->xSync(real(file), flags);
  if (state != nullptr && code == SQLITE_OK) {
    for (const Change& change : state->pending) {
      change.apply_to(state->durable);
    }
    state->pending.clear();
  }
  return code;
}

int shim_size(sqlite3_file* file, sqlite3_int64* size) { return real(file)->pMethods->xFileSize(real(file), size); }
int shim_lock(sqlite3_file* file, int level) { return real(file)->pMethods->xLock(real(file), level); }
int shim_unlock(sqlite3_file* file, int level) { return real(file)->pMethods->xUnlock(real(file), level); }
int shim_reserved(sqlite3_file* file, int* out) { return real(file)->pMethods->xCheckReservedLock(real(file), out); }
int shim_sector(sqlite3_file* file) { return real(file)->pMethods->xSectorSize(real(file)); }
int shim_traits(sqlite3_file* file) { return real(file)->pMethods->xDeviceCharacteristics(real(file)); }

int shim_control(sqlite3_file* file, int what, void* argument) {
  if (what == SQLITE_FCNTL_SIZE_HINT || what == SQLITE_FCNTL_CHUNK_SIZE || what == SQLITE_FCNTL_MMAP_SIZE) {
    return SQLITE_NOTFOUND;  // these change the file behind our back
  }
  return real(file)->pMethods->xFileControl(real(file), what, argument);
}

int shim_shm_map(sqlite3_file* file, int region, int size, int extend, void volatile** out) {
  if (shim(file)->mine && extend != 0 && g_disk->fails(Call::shared_memory)) {
    return g_disk->fault->kind == FaultKind::io_error ? SQLITE_IOERR_SHMMAP : SQLITE_IOERR_SHMSIZE;
  }
  return real(file)->pMethods->xShmMap(real(file), region, size, extend, out);
}
int shim_shm_lock(sqlite3_file* file, int offset, int count, int flags) {
  return real(file)->pMethods->xShmLock(real(file), offset, count, flags);
}
void shim_shm_barrier(sqlite3_file* file) { real(file)->pMethods->xShmBarrier(real(file)); }
int shim_shm_unmap(sqlite3_file* file, int remove) { return real(file)->pMethods->xShmUnmap(real(file), remove); }

const sqlite3_io_methods kMethods{
    2,           shim_close,   shim_read,     shim_write,       shim_truncate,  shim_sync,
    shim_size,   shim_lock,    shim_unlock,   shim_reserved,    shim_control,   shim_sector,
    shim_traits, shim_shm_map, shim_shm_lock, shim_shm_barrier, shim_shm_unmap, nullptr,
    nullptr};

int shim_open(sqlite3_vfs*, const char* path, sqlite3_file* file, int flags, int* out_flags) {
  const bool mine = g_disk->mine(path);
  shim(file)->base.pMethods = nullptr;
  if (mine && g_disk->fails(Call::open)) {
    return g_disk->fault->kind == FaultKind::io_error ? SQLITE_IOERR : SQLITE_CANTOPEN;
  }
  const bool existed = mine && fs::exists(path);
  const int code = g_disk->real->xOpen(g_disk->real, path, real(file), flags, out_flags);
  if (real(file)->pMethods != nullptr) {
    shim(file)->base.pMethods = &kMethods;
    shim(file)->mine = mine;
    shim(file)->id = mine ? g_disk->file(fs::path(path).filename().string(), existed) : 0;
  }
  return code;
}

int shim_delete(sqlite3_vfs*, const char* path, int sync_folder) {
  if (g_disk->mine(path)) {
    if (!fs::exists(path)) {
      return SQLITE_IOERR_DELETE_NOENT;
    }
    if (g_disk->fails(Call::remove)) {
      return SQLITE_IOERR_DELETE;
    }
    g_disk->file(fs::path(path).filename().string(), true);
    g_disk->remove(fs::path(path).filename().string());
  }
  return g_disk->real->xDelete(g_disk->real, path, sync_folder);
}

}  // namespace

FileId FaultyDisk::Impl::file(const std::string& name, bool existed) {
  const auto known = names.find(name);
  if (known != names.end() && existed) {
    return known->second;
  }
  files.push_back({existed ? read_all(folder / name) : std::string(), {}});
  const FileId id = files.size() - 1;
  names[name] = id;
  if (existed) {
    durable_names[name] = id;
  } else {
    pending_names.push_back({{}, name, id});
  }
  return id;
}

void FaultyDisk::Impl::rename(const std::string& from, const std::string& to) {
  const FileId id = file(from, true);
  pending_names.push_back({from, to, id});
  pending_names.back().apply_to(names);
}

void FaultyDisk::Impl::remove(const std::string& name) {
  pending_names.push_back({name, {}, 0});
  pending_names.back().apply_to(names);
}

std::uint64_t FaultyDisk::Impl::used() const {
  std::uint64_t bytes = 0;
  for (const auto& entry : fs::directory_iterator(folder)) {
    bytes += entry.path().extension() == ".db-shm" ? 0 : entry.file_size();
  }
  return bytes;
}

void FaultyDisk::Impl::folder_synced() {
  for (const NameChange& change : pending_names) {
    change.apply_to(durable_names);
  }
  pending_names.clear();
}

/// Every call that changes something begins here.
bool FaultyDisk::Impl::fails(Call call) {
  if (hook) {
    hook(call);
  }
  const std::uint64_t number = calls++;
  const bool now = fault && (number == fault->at || (fault->for_good && number > fault->at));
  struck = struck || now;
  return now;
}

FaultyDisk::FaultyDisk(const fs::path& folder) : impl_(std::make_unique<Impl>()) {
  if (g_disk != nullptr) {
    throw std::logic_error("one FaultyDisk at a time");
  }
  impl_->folder = folder;
  if (fs::exists(folder)) {
    for (const auto& entry : fs::directory_iterator(folder)) {
      impl_->file(entry.path().filename().string(), true);
    }
  }
  impl_->real = sqlite3_vfs_find(nullptr);
  impl_->vfs = *impl_->real;
  impl_->vfs.zName = "faulty";
  impl_->vfs.szOsFile = impl_->real->szOsFile + kShimBytes;
  impl_->vfs.xOpen = shim_open;
  impl_->vfs.xDelete = shim_delete;
  g_disk = impl_.get();
  sqlite3_vfs_register(&impl_->vfs, 1);
}

FaultyDisk::~FaultyDisk() {
  sqlite3_vfs_unregister(&impl_->vfs);
  sqlite3_vfs_register(impl_->real, 1);
  g_disk = nullptr;
}

std::uint64_t FaultyDisk::calls() const { return impl_->calls; }
void FaultyDisk::before_each_call(std::function<void(Call)> hook) { impl_->hook = std::move(hook); }
void FaultyDisk::set_capacity(std::optional<std::uint64_t> bytes) { impl_->capacity = bytes; }
std::uint64_t FaultyDisk::used() const { return impl_->used(); }
void FaultyDisk::inject(const Fault& fault) {
  impl_->fault = fault;
  impl_->struck = false;
}
void FaultyDisk::heal() { impl_->fault.reset(); }
bool FaultyDisk::struck() const { return impl_->struck; }

namespace {

/// The changes since the last sync as a disk without power left them.
std::string content_after_cut(const FileState& file, std::mt19937& random) {
  std::string content = file.durable;
  // Some cuts lose nearly everything, some nearly nothing: both are worth meeting.
  const auto kept_of_8 = random() % 9;
  for (const Change& change : file.pending) {
    const bool kept = random() % 8 < kept_of_8;
    if (!change.truncate && random() % 8 == 0) {
      const std::uint64_t end = change.offset + change.bytes.size();
      const std::uint64_t first = change.offset / kSector + 1;
      const std::uint64_t cut = std::min((first + random() % (change.bytes.size() / kSector + 1)) * kSector, end);
      const auto middle = static_cast<std::size_t>(cut - change.offset);
      change.apply_to(content, kept ? 0 : middle, kept ? middle : change.bytes.size());
    } else if (kept) {
      change.apply_to(content);
    }
  }
  return content;
}

}  // namespace

FaultyDisk::Image FaultyDisk::after_power_cut(std::mt19937& random) const {
  Image image;
  image.exists = impl_->folder_durable || random() % 2 == 0;
  if (!image.exists) {
    return image;
  }
  Names names = impl_->durable_names;
  const auto all = static_cast<unsigned>(impl_->pending_names.size());
  const std::array<unsigned, 3> choices{0, all, static_cast<unsigned>(random() % (all + 1))};
  const unsigned kept = choices[random() % choices.size()];
  for (unsigned i = 0; i < kept; ++i) {
    impl_->pending_names[i].apply_to(names);
  }
  for (const auto& [name, id] : names) {
    image.files[name] = content_after_cut(impl_->files[id], random);
  }
  return image;
}

void write_image(const FaultyDisk::Image& image, const fs::path& folder) {
  fs::remove_all(folder);
  if (!image.exists) {
    return;
  }
  fs::create_directories(folder);
  for (const auto& [name, content] : image.files) {
    std::ofstream(folder / name, std::ios::binary) << content;
  }
}

namespace {

int fails_with_errno(Call call) {
  if (g_disk->fails(call)) {
    errno = g_disk->fault_errno();
    return -1;
  }
  return 0;
}

int sync_any(int file, long system_call) {
  struct stat info {};
  if (g_disk == nullptr) {
    return static_cast<int>(syscall(system_call, file));
  }
  if (fstat(file, &info) != 0 || !S_ISDIR(info.st_mode)) {
    return 0;  // files are synced in shim_sync
  }
  const fs::path folder = fs::read_symlink("/proc/self/fd/" + std::to_string(file));
  if (folder == g_disk->folder) {
    if (fails_with_errno(Call::folder_sync) != 0) {
      return -1;
    }
    g_disk->folder_synced();
  } else if (folder == g_disk->folder.parent_path()) {
    g_disk->folder_durable = true;
  }
  return 0;
}

}  // namespace

}  // namespace tacho::test

// These take the place of the C library's, also for libsqlite3 and libstdc++.
extern "C" {

int fsync(int file) { return tacho::test::sync_any(file, SYS_fsync); }
int fdatasync(int file) { return tacho::test::sync_any(file, SYS_fdatasync); }

int rename(const char* from, const char* to) noexcept {
  using tacho::test::g_disk;
  const bool mine = g_disk != nullptr && g_disk->mine(from) && g_disk->mine(to);
  if (mine && tacho::test::fails_with_errno(tacho::test::Call::rename) != 0) {
    return -1;
  }
  const int result = static_cast<int>(syscall(SYS_rename, from, to));
  if (mine && result == 0) {
    g_disk->rename(std::filesystem::path(from).filename().string(), std::filesystem::path(to).filename().string());
  }
  return result;
}

int remove(const char* path) noexcept {
  using tacho::test::g_disk;
  struct stat info {};
  const bool mine = g_disk != nullptr && g_disk->mine(path) && lstat(path, &info) == 0;
  if (mine && tacho::test::fails_with_errno(tacho::test::Call::remove) != 0) {
    return -1;
  }
  if (mine) {
    g_disk->file(std::filesystem::path(path).filename().string(), true);
  }
  int result = static_cast<int>(syscall(SYS_unlink, path));
  if (result != 0 && errno == EISDIR) {
    result = static_cast<int>(syscall(SYS_rmdir, path));
  }
  if (mine && result == 0) {
    g_disk->remove(std::filesystem::path(path).filename().string());
  }
  return result;
}

int mkdir(const char* path, mode_t mode) noexcept {
  using tacho::test::g_disk;
  const bool mine = g_disk != nullptr && std::filesystem::path(path) == g_disk->folder;
  if (mine && tacho::test::fails_with_errno(tacho::test::Call::make_folder) != 0) {
    return -1;
  }
  const int result = static_cast<int>(syscall(SYS_mkdir, path, mode));
  if (mine && result == 0) {
    g_disk->folder_durable = false;
  }
  return result;
}

}  // extern "C"
