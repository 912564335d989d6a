#include "schema/store/block/block_decoder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "schema/store/block/row_text.hpp"
#include "schema/store/checksum.hpp"

namespace tacho::store {

namespace {

constexpr std::string_view kShapesOfRows = "which row has which shape is damaged";

std::string raw_damage(std::uint32_t rows) {
  return fmt::format("{} answers that were kept as they are are damaged", rows);
}

/// The frame's bytes; empty when they are not those that were written.
std::string_view frame_of(BlockBytes& block, const TextFrame& frame) {
  const std::string_view bytes = block.at(frame.offset, frame.length);
  return static_cast<std::uint32_t>(Checksum().add_bytes(bytes).value()) == frame.checksum ? bytes : std::string_view{};
}

std::vector<ShapePart> whole_shapes(const ShapeTable& table) {
  std::vector<ShapePart> parts;
  for (const Shape& shape : table.shapes()) {
    std::size_t length = shape.columns.size();
    for (const std::string& piece : shape.pieces) {
      length += piece.size();
    }
    parts.push_back({0, length, 0, shape.columns.size()});
  }
  return parts;
}

}  // namespace

std::string BlockDecoder::open(BlockBytes& block) {
  block_ = &block;
  shape_of_row_.clear();
  constants_ = Constants::unread;
  reader_.start(block);
  reader_.set_budget(kBlockBudget);
  std::string damage = read_block(block, head_, directory_);
  if (damage.empty()) {
    shapes_good_ = load_shapes();
  }
  return damage;
}

bool BlockDecoder::load_shapes() {
  // Equal to bytes that were good is good: their checksum need not be looked at.
  const std::string_view stored = block_->at(directory_.shapes.offset, directory_.shapes.length);
  const std::size_t leaves = directory_.columns - kRowColumns;
  const auto known = std::find_if(known_.begin(), known_.end(), [&](const KnownShapes& shapes) {
    return shapes.source == head_.source && shapes.frame == stored &&
           shapes.table->shapes().size() == directory_.shapes.count;
  });
  if (known != known_.end()) {
    table_ = known->table;
    return leaves == table_->columns().size();
  }
  const std::string_view frame = frame_of(*block_, directory_.shapes);
  auto table = std::make_shared<ShapeTable>(head_.source);
  table_ = std::make_shared<const ShapeTable>(head_.source);
  ByteReader in(frame);
  std::vector<std::string_view> texts;
  std::vector<char> storage;
  if (frame.empty() || directory_.shapes.count > kMaxShapes ||
      !reader_.take_texts(in, directory_.shapes.count, texts, storage) ||
      !std::all_of(texts.begin(), texts.end(), [&](std::string_view text) { return table->add(text); })) {
    return false;
  }
  table_ = table;
  constexpr std::size_t kKept = 32;
  known_.resize(std::min(known_.size() + 1, kKept));
  known_[oldest_++ % kKept] = {head_.source, std::string(frame), table_};
  return leaves == table_->columns().size();
}

bool BlockDecoder::load_constants() {
  if (constants_ == Constants::unread) {
    constants_ = Constants::damaged;
    const std::string_view frame = frame_of(*block_, directory_.constants);
    ByteReader in(frame);
    std::vector<std::string_view> texts;
    if (!frame.empty() && reader_.take_texts(in, directory_.constants.count, texts, constant_bytes_)) {
      reader_.set_constants(std::move(texts));
      constants_ = Constants::good;
    }
  }
  return constants_ == Constants::good;
}

bool BlockDecoder::load(std::uint32_t position, LoadedColumn& column, const IntReader::UseRun* numbers) {
  std::size_t number = 0;
  const ColumnEntry* const entry = directory_.find(position, number);
  if (entry == nullptr) {
    return load_constants() && reader_.load_constant(number, column);
  }
  // Only composites have constant parts.
  return (entry->form != ColumnForm::composite || load_constants()) &&
         (numbers != nullptr ? reader_.load(*entry, column, *numbers) : reader_.load(*entry, column));
}

bool BlockDecoder::load_values(RowColumn column, const IntReader::UseRun& use) {
  std::size_t number = 0;
  const ColumnEntry* const entry = directory_.find(column, number);
  return entry != nullptr && entry->form == ColumnForm::numbers && entry->count == head_.rows &&
         entry->exceptions == 0 && reader_.load(*entry, row_column_, use);
}

bool BlockDecoder::load_values(RowColumn column, std::vector<std::int64_t>& values) {
  values.resize(head_.rows);
  return load_values(column, [&](std::size_t begin, std::span<const std::int64_t> run) {
    std::copy(run.begin(), run.end(), values.begin() + static_cast<std::ptrdiff_t>(begin));
  });
}

bool BlockDecoder::load_shape_of_row() {
  if (shape_of_row_.empty()) {
    const auto limit = static_cast<std::int64_t>(directory_.shapes.count);
    if (!load_values(kShapeColumn, shape_of_row_) ||
        !std::all_of(shape_of_row_.begin(), shape_of_row_.end(),
                     [&](std::int64_t shape) { return shape >= 0 && shape <= limit; })) {
      shape_of_row_.clear();
      return false;
    }
    count_leaf_rows();
  }
  return true;
}

void BlockDecoder::count_leaf_rows() {
  std::vector<std::uint32_t> rows_of_shape(table_->shapes().size() + 1);
  for (const std::int64_t shape : shape_of_row_) {
    rows_of_shape[std::min(static_cast<std::size_t>(shape), rows_of_shape.size() - 1)]++;
  }
  rows_of_leaf_.assign(table_->columns().size(), 0);
  for (std::size_t s = 0; s < table_->shapes().size(); ++s) {
    for (const std::uint32_t leaf : table_->shapes()[s].columns) {
      rows_of_leaf_[leaf] += rows_of_shape[s + 1];
    }
  }
}

std::vector<ColumnInfo> BlockDecoder::columns() const {
  std::vector<ColumnInfo> infos;
  for (std::size_t leaf = 0; shapes_good_ && leaf < table_->columns().size(); ++leaf) {
    ColumnInfo& info = infos.emplace_back();
    info.path = table_->columns()[leaf].path;
    info.occurrence = table_->columns()[leaf].occurrence;
    std::size_t number = 0;
    const ColumnEntry* const entry = directory_.find(static_cast<std::uint32_t>(kRowColumns + leaf), number);
    if (entry == nullptr) {
      continue;
    }
    info.form = entry->form;
    info.count = entry->count;
    info.exceptions = entry->exceptions;
    info.style = entry->style;
    const std::function<std::size_t(const ColumnEntry&)> bytes = [&](const ColumnEntry& e) {
      std::size_t total = e.length;
      for (const ColumnEntry& child : e.children) {
        total += bytes(child);
      }
      return total;
    };
    info.bytes = bytes(*entry);
    if (entry->form == ColumnForm::numbers) {
      const std::int64_t values[] = {entry->min, entry->max, entry->first, entry->last};
      double reals[4];
      to_reals(entry->style, values, reals);
      info.min = reals[0];
      info.max = reals[1];
      info.first = reals[2];
      info.last = reals[3];
    }
  }
  return infos;
}

std::string BlockDecoder::times(std::vector<std::uint64_t>& seq, std::vector<Micros>& t_send_us,
                                std::vector<Micros>& t_recv_us) {
  reader_.set_budget(kBlockBudget);
  seq.resize(head_.rows);
  t_recv_us.resize(head_.rows);
  const auto put_seq = [&](std::size_t begin, std::span<const std::int64_t> run) {
    std::copy(run.begin(), run.end(), seq.begin() + static_cast<std::ptrdiff_t>(begin));
  };
  const auto put_recv = [&](std::size_t begin, std::span<const std::int64_t> run) {
    for (std::size_t i = 0; i < run.size(); ++i) {
      t_recv_us[begin + i] =
          static_cast<Micros>(static_cast<std::uint64_t>(run[i]) + static_cast<std::uint64_t>(t_send_us[begin + i]));
    }
  };
  return load_values(kSeqColumn, put_seq) && load_values(kSendColumn, t_send_us) &&
                 load_values(kRoundTripColumn, put_recv)
             ? ""
             : "numbers and times of the rows are damaged";
}

std::string BlockDecoder::places(std::vector<std::int64_t>& places) {
  reader_.set_budget(kBlockBudget);
  return load_values(kPlaceColumn, places) ? "" : "places of the rows are damaged";
}

bool BlockDecoder::load_raw(LoadedColumn& raw) {
  std::size_t number = 0;
  const ColumnEntry* const entry = directory_.find(kRawColumn, number);
  const auto rows = static_cast<std::size_t>(std::count(shape_of_row_.begin(), shape_of_row_.end(), 0));
  return rows == head_.raw_rows && load(kRawColumn, raw) && raw.form != ColumnForm::numbers &&
         (entry == nullptr || entry->count == rows);
}

bool BlockDecoder::load_headers(LoadedColumn& headers) {
  std::size_t number = 0;
  const ColumnEntry* const entry = directory_.find(kHeaderColumn, number);
  return load(kHeaderColumn, headers) && headers.form != ColumnForm::numbers &&
         (entry == nullptr || entry->count == head_.rows);
}

bool BlockDecoder::load_leaf(std::uint32_t leaf, LoadedColumn& column, const IntReader::UseRun* numbers) {
  std::size_t number = 0;
  const ColumnEntry* const entry = directory_.find(kRowColumns + leaf, number);
  const bool everywhere = head_.raw_rows == 0 && table_->columns()[leaf].shapes == table_->shapes().size();
  if (!everywhere && !load_shape_of_row()) {
    return false;
  }
  const std::uint32_t rows = everywhere ? head_.rows : rows_of_leaf_[leaf];
  return (entry == nullptr || entry->count == rows) && load(kRowColumns + leaf, column, numbers);
}

std::string BlockDecoder::raw_bodies(const std::function<void(std::size_t, std::string_view)>& yield) {
  reader_.set_budget(kBlockBudget);
  if (head_.raw_rows == 0) {
    return "";
  }
  if (!load_shape_of_row()) {
    return std::string(kShapesOfRows);
  }
  LoadedColumn raw;
  if (!load_raw(raw)) {
    return raw_damage(head_.raw_rows);
  }
  std::string body;
  std::size_t next = 0;
  for (std::size_t row = 0; row < shape_of_row_.size(); ++row) {
    if (shape_of_row_[row] == 0) {
      body.clear();
      raw.append(next++, body);
      yield(row, body);
    }
  }
  return "";
}

std::string BlockDecoder::answers(const std::function<void(std::size_t, const Answer&)>& yield) {
  std::vector<std::uint64_t> seq;
  std::vector<Micros> send;
  std::vector<Micros> recv;
  std::string damage = times(seq, send, recv);
  if (!damage.empty()) {
    return damage;
  }
  if (!load_shape_of_row()) {
    return std::string(kShapesOfRows);
  }
  const auto note = [&](const std::string& what) { damage += (damage.empty() ? "" : "; ") + what; };
  std::vector<LoadedColumn> loaded(table_->columns().size());
  RowText text(*table_, shapes_good_ ? whole_shapes(*table_) : std::vector<ShapePart>(),
               [&](std::uint32_t leaf) { return load_leaf(leaf, loaded[leaf]) ? &loaded[leaf] : nullptr; });
  LoadedColumn header;
  const bool headers = load_headers(header);
  if (!headers) {
    note("unusual frame headers are damaged and left out");
  }
  LoadedColumn raw;
  const bool raw_good = head_.raw_rows == 0 || load_raw(raw);
  if (!raw_good) {
    note(raw_damage(head_.raw_rows));
  }

  Answer answer;
  std::size_t next_raw = 0;
  std::size_t lost = 0;
  for (std::size_t row = 0; row < head_.rows; ++row) {
    const auto shape = static_cast<std::size_t>(shape_of_row_[row]);
    answer.body.clear();
    if (shape == 0) {
      if (!raw_good) {
        continue;
      }
      raw.append(next_raw++, answer.body);
    } else if (!shapes_good_ || !text.append(shape - 1, answer.body)) {
      ++lost;
      continue;
    }
    answer.meta = {head_.robot, head_.source, head_.session, seq[row], send[row], recv[row]};
    answer.header.clear();
    if (headers) {
      header.append(row, answer.header);
    }
    yield(row, answer);
  }
  if (lost > 0) {
    note(fmt::format("{} of {} answers are left out: {} damaged", lost, head_.rows,
                     shapes_good_ ? "column " + text.missing() + " is" : std::string("the shapes are")));
  }
  return damage;
}

}  // namespace tacho::store
