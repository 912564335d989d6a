#include "schema/store/block/block_encoder.hpp"

#include <algorithm>
#include <map>
#include <string_view>
#include <utility>

#include "schema/store/block/block_decoder.hpp"
#include "schema/store/block/block_format.hpp"
#include "schema/store/block/shape_table.hpp"

namespace tacho::store {

namespace {

/// A block with more body bytes than this is full: it must fit in memory several times over.
constexpr std::size_t kFullBytes = std::size_t{32} << 20U;
/// Leaves of a block; more would need more memory to read than a decoder gives it.
constexpr std::size_t kMaxLeaves = std::size_t{4} << 20U;

bool same_stream(const AnswerMeta& a, const AnswerMeta& b) {
  return a.robot == b.robot && a.source == b.source && a.session == b.session;
}

bool same(const Answer& a, const Answer& b) {
  return same_stream(a.meta, b.meta) && a.meta.seq == b.meta.seq && a.meta.t_send_us == b.meta.t_send_us &&
         a.meta.t_recv_us == b.meta.t_recv_us && a.body == b.body && a.header == b.header;
}

/// The answers of a block sorted into columns of texts.
class Sorter {
 public:
  explicit Sorter(Source source) : table_(source) {}

  void add(const std::string& body, bool keep_raw) {
    std::int64_t number = 0;
    if (!keep_raw && table_.split(body, shape_, leaves_) && leaf_count_ + leaves_.size() <= kMaxLeaves) {
      number = shape_number();
    }
    shape_of_row_.push_back(number);
    if (number == 0) {
      raw_.push_back(body);
      return;
    }
    leaf_count_ += leaves_.size();
    const std::vector<std::uint32_t>& columns = table_.shapes()[static_cast<std::size_t>(number) - 1].columns;
    for (std::size_t i = 0; i < columns.size(); ++i) {
      texts_[columns[i]].push_back(leaves_[i]);
    }
  }

  [[nodiscard]] const ShapeTable& table() const { return table_; }
  [[nodiscard]] const std::vector<std::vector<std::string_view>>& texts() const { return texts_; }
  [[nodiscard]] const std::vector<std::int64_t>& shape_of_row() const { return shape_of_row_; }
  [[nodiscard]] const std::vector<std::string_view>& raw() const { return raw_; }

 private:
  ShapeTable table_;
  std::map<std::string, std::int64_t, std::less<>> numbers_;
  std::vector<std::vector<std::string_view>> texts_;  // per column of the table
  std::vector<std::int64_t> shape_of_row_;
  std::vector<std::string_view> raw_;
  std::size_t leaf_count_ = 0;
  std::string shape_;
  std::vector<std::string_view> leaves_;

  /// From 1; 0 when the shape cannot be one of the block's.
  std::int64_t shape_number() {
    const auto found = numbers_.find(shape_);
    if (found != numbers_.end()) {
      return found->second;
    }
    if (!table_.add(shape_)) {
      return 0;
    }
    texts_.resize(table_.columns().size());
    const auto number = static_cast<std::int64_t>(table_.shapes().size());
    numbers_.emplace(shape_, number);
    return number;
  }
};

EncodedColumn encode_texts(ColumnWriter& writer, const std::vector<std::string_view>& texts) {
  return texts.empty() ? EncodedColumn() : writer.encode(texts, LeafType::bytes);
}

}  // namespace

BlockEncoder::BlockEncoder(const BlockOptions& options) : options_(options) {
  options_.rows = std::clamp<std::size_t>(options_.rows, 1, kMaxBlockRows);
}

bool BlockEncoder::add(const Answer& answer, std::int64_t place) {
  const bool full = answers_.size() >= options_.rows || bytes_ + answer.body.size() > kFullBytes;
  if (!answers_.empty() && (full || !same_stream(answers_.front().meta, answer.meta))) {
    return false;
  }
  bytes_ += answer.body.size();
  answers_.push_back(answer);
  places_.push_back(place);
  return true;
}

std::string BlockEncoder::finish() {
  if (answers_.empty()) {
    return {};
  }
  std::vector<bool> keep_raw(answers_.size(), false);
  std::string block = build(keep_raw);
  std::size_t unlike_rows = 0;
  // Taking rows out of the columns changes how the others are stored, so look again; keeping all raw ends it.
  for (const bool all : {false, true}) {
    const std::vector<bool> wrong = unlike(block);
    const auto count = static_cast<std::size_t>(std::count(wrong.begin(), wrong.end(), true));
    if (count == 0) {
      break;
    }
    unlike_rows += count;
    for (std::size_t i = 0; i < wrong.size(); ++i) {
      keep_raw[i] = keep_raw[i] || wrong[i] || all;
    }
    block = build(keep_raw);
  }
  stats_.unlike_rows = unlike_rows;
  answers_.clear();
  places_.clear();
  bytes_ = 0;
  return block;
}

std::string BlockEncoder::build(const std::vector<bool>& keep_raw) {
  const AnswerMeta& first = answers_.front().meta;
  const AnswerMeta& last = answers_.back().meta;
  Sorter sorter(first.source);
  std::vector<std::int64_t> seq;
  std::vector<std::int64_t> send;
  std::vector<std::int64_t> round_trip;
  std::vector<std::string_view> headers;
  for (std::size_t i = 0; i < answers_.size(); ++i) {
    const Answer& answer = answers_[i];
    sorter.add(answer.body, keep_raw[i]);
    seq.push_back(static_cast<std::int64_t>(answer.meta.seq));
    send.push_back(answer.meta.t_send_us);
    round_trip.push_back(static_cast<std::int64_t>(static_cast<std::uint64_t>(answer.meta.t_recv_us) -
                                                   static_cast<std::uint64_t>(answer.meta.t_send_us)));
    headers.push_back(answer.header);
  }

  ColumnWriter writer(options_.level, options_.order);
  std::vector<EncodedColumn> columns(kRowColumns);
  columns[kSeqColumn] = writer.encode_values(seq);
  columns[kSendColumn] = writer.encode_values(send);
  columns[kRoundTripColumn] = writer.encode_values(round_trip);
  columns[kShapeColumn] = writer.encode_values(sorter.shape_of_row());
  columns[kHeaderColumn] = encode_texts(writer, headers);
  columns[kRawColumn] = encode_texts(writer, sorter.raw());
  columns[kPlaceColumn] = writer.encode_values(places_);
  for (std::size_t c = 0; c < sorter.texts().size(); ++c) {
    columns.push_back(writer.encode(sorter.texts()[c], sorter.table().columns()[c].type));
  }
  std::vector<std::string_view> shapes;
  for (const Shape& shape : sorter.table().shapes()) {
    shapes.push_back(shape.text);
  }

  stats_ = {shapes.size(), sorter.raw().size(), 0};
  BlockHead head;
  head.robot = first.robot;
  head.source = first.source;
  head.session = first.session;
  head.order = options_.order;
  head.rows = static_cast<std::uint32_t>(answers_.size());
  head.raw_rows = static_cast<std::uint32_t>(sorter.raw().size());
  head.seq_first = first.seq;
  head.seq_last = last.seq;
  head.t_first_us = first.t_send_us;
  head.t_last_us = last.t_send_us;
  return write_block(head, shapes, columns, writer.packer());
}

std::vector<bool> BlockEncoder::unlike(const std::string& block) const {
  std::vector<bool> wrong(answers_.size(), true);
  BlockDecoder decoder;
  if (!decoder.open(block).empty()) {
    return wrong;
  }
  const std::string damage =
      decoder.answers([&](std::size_t row, const Answer& answer) { wrong[row] = !same(answers_[row], answer); });
  return wrong;
}

}  // namespace tacho::store
