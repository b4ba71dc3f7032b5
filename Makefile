# hydra: `make demo` needs a C compiler and nothing else; `make test` checks everything and sets itself up.
#
#   make headers       hydra.h, hydra_vk.h, from parts    make test          everything below but fuzz, bench
#   make spirv         src/vk/spirv.h from shaders/       make unit          the unit tests (T="bvh film": some)
#   make demo          a picture and what it cost         make unit-vk       those that can, on Vulkan (T=...)
#   make examples      all of examples/                   make test-asan     unit tests under ASan and UBSan
#   make bench         all of bench/ (QUICK=1: short)     make test-tsan     those with threads under TSan
#   make bench-<name>  one of them                        make test-fast     those of every bit with clang's -ffast-math
#                                                         make check-...     generated, prefix, shared, matrix
#   make fuzz          FUZZ_SECONDS=20 for each target    make format, tidy  clang-format, clang-tidy
MAKEFLAGS += --no-builtin-rules
.SUFFIXES:
.DELETE_ON_ERROR:

ifeq ($(origin CC),default)
CC := $(firstword $(foreach c,gcc cc clang,$(if $(shell command -v $(c) 2>/dev/null),$(c))) cc)
endif
CXX ?= g++
CLANG ?= clang
OPT ?= -O2
BENCH_OPT ?= -O3
LIBS := -lm -pthread
export CC CXX

.PHONY: all headers spirv test unit unit-vk test-asan test-tsan test-fast test-readme demo examples bench fuzz format tidy clean FORCE \
	check-generated check-prefix check-shared check-matrix setup-cc setup-shaders setup-test setup-examples setup-fuzz setup-lint
.DEFAULT_GOAL := all

all: headers examples

# ---- the headers. Made when asked for, never on the way to something else: what is tested is what is committed.

headers: hydra.h hydra_vk.h

# header, how the amalgamator is asked for it
define header
ifneq ($(filter all headers $(1),$(or $(MAKECMDGOALS),all))$(if $(wildcard $(1)),,missing),)
$(1): build/amalgamate FORCE
	@build/amalgamate $(2) build/$(1).new
	@cmp -s build/$(1).new $(1) && echo "$(1) is fresh" || { cp build/$(1).new $(1) && echo "made $(1)"; }
endif
endef
$(eval $(call header,hydra.h,))
$(eval $(call header,hydra_vk.h,--vk))

spirv: setup-shaders
	@shaders/compile.sh src/vk/spirv.h

build/amalgamate: tools/amalgamate.c
	@mkdir -p build
	$(CC) -std=c99 -O1 $< -o $@

FORCE:

# ---- what is installed where it is missing

setup-cc:
	@CC=$(CC) sh -c 'command -v $$CC >/dev/null' || .ci/setup cc
setup-shaders:
	@.ci/setup shaders
setup-test:
	@.ci/setup cc shaders tests examples
setup-examples:
	@.ci/setup cc examples
setup-fuzz:
	@.ci/setup cc fuzz
setup-lint:
	@.ci/setup lint

# ---- demo, examples

demo: setup-cc build/demo
	@build/demo build/demo.png

build/demo: examples/demo.c hydra.h
	@mkdir -p build
	$(CC) -std=c99 $(OPT) -I. $< -o $@ $(LIBS)

# A program of examples/ or bench/ is one file, or a folder of files; what it links with follows from what it includes.
programs = $(sort $(patsubst $(1)/%.c,%,$(wildcard $(1)/*.c)) $(patsubst $(1)/%/,%,$(dir $(wildcard $(1)/*/*.c))))
uses = $(shell grep -qE '^ *\# *include *[<"]$(2)' $(1) && echo yes)
defines = $(shell grep -qE '^ *\# *define *$(2)' $(1) && echo yes)
there = $(shell echo '\#include <$(1)>' | $(CC) -E -x c - >/dev/null 2>&1 && echo yes)
openexr = $(shell pkg-config --cflags --libs-only-L OpenEXR) $(or $(filter -lOpenEXRCore%,$(shell pkg-config --libs OpenEXR)),-lOpenEXRCore)
libraries = $(if $(call uses,$(1),assimp/),-lassimp) $(if $(call uses,$(1),(OpenEXR/)?openexr),$(openexr)) \
	$(if $(call uses,$(1),stb/),$(if $(call defines,$(1),STB_[A-Z_]*IMPLEMENTATION),,-lstb)) \
	$(if $(call uses,$(1),embree3/),$(if $(call there,embree3/rtcore.h),-lembree3))

define program
build/$(1)/$(2): $(wildcard $(1)/$(2).c $(1)/$(2)/*.c) hydra.h $(wildcard $(1)/*.h $(1)/$(2)/*.h)
	@mkdir -p $$(@D)
	$$(CC) -std=gnu99 $(3) -Wall -Wextra -I. $$(filter %.c,$$^) -o $$@ $$(call libraries,$$(filter %.c,$$^)) $$(LIBS)
endef

EXAMPLES := $(patsubst %,build/examples/%,$(call programs,examples))
examples: $(if $(filter-out build/examples/demo,$(EXAMPLES)),setup-examples) $(EXAMPLES)
$(foreach p,$(call programs,examples),$(eval $(call program,examples,$(p),$(OPT))))

# ---- bench: bench/<name>.c or bench/<name>/ is `make bench-<name>`. Each prints its goals and writes under build/bench.

BENCHES := $(patsubst %,bench-%,$(call programs,bench))
.PHONY: $(BENCHES)
bench: $(BENCHES)
	@test -n "$(BENCHES)" || echo "bench: no programs in bench/"
$(BENCHES): bench-%: setup-cc build/bench/%
	@QUICK=$(QUICK) build/bench/$*
$(foreach p,$(call programs,bench),$(eval $(call program,bench,$(p),$(BENCH_OPT))))

# ---- unit tests: tests/test_<subject>.c, built in four ways

ALL_SUBJECTS := $(sort $(patsubst tests/test_%.c,%,$(wildcard tests/test_*.c)))
SUBJECTS := $(filter-out vk_%,$(ALL_SUBJECTS))
# Those that look inside the implementation.
INSIDE := $(patsubst tests/test_%.c,%,$(shell grep -lE '^\# *define HYDRA_IMPLEMENTATION' $(ALL_SUBJECTS:%=tests/test_%.c)))
# On Vulkan: all tests of the API, by the same source, and those about Vulkan alone. What a device cannot have is left out
# test by test, each saying why. Those that look inside call the host's functions themselves: trees and their traversal,
# the kernels' C, sums, which a device context does not change. vk_equal holds the device's kernels against these.
VK_SUBJECTS := $(filter-out $(filter-out vk_%,$(INSIDE)),$(ALL_SUBJECTS))
# Those that start threads: the words by which a test asks for them.
TSAN_SUBJECTS := $(or $(TSAN_SUBJECTS),$(patsubst tests/test_%.c,%,$(sort \
	$(shell grep -lE 'ht_open_threads|[.>]threads *=|pthread_create|parallel_for' $(SUBJECTS:%=tests/test_%.c)))))
SUPPORT := $(filter-out main test_%,$(patsubst tests/%.c,%,$(wildcard tests/*.c)))
# -g1: to follow variables through the traversal, gcc takes minutes a file. -std=c99 alone would keep the compiler from
# contracting products and sums, which it does for whoever asks for no standard: bits must not follow from that.
TEST_FLAGS := -std=c99 -ffp-contract=fast -D_POSIX_C_SOURCE=200809L -D_DEFAULT_SOURCE -g1 -Wall -Wextra -I. -Itests

# The implementation is compiled once, and in one piece with the tests that look inside it: alone, each of those would
# take as long again. So their names must not clash; the compiler tells.
# name, compiler, flags, subjects, headers beside hydra.h
define flavour
.PHONY: $(1)-program
$(1)-program: build/$(1)/tests
build/$(1)/subjects.h: FORCE
	@mkdir -p build/$(1)
	@printf 'HT_SUBJECT(%s)\n' $(4) > $$@.new; cmp -s $$@.new $$@ && rm $$@.new || mv $$@.new $$@
build/$(1)/main.o: tests/main.c build/$(1)/subjects.h tests/hydra_test_run.h
	$(2) $$(TEST_FLAGS) $(3) -Ibuild/$(1) -c $$< -o $$@
build/$(1)/%.o: tests/%.c hydra.h $(5) $(wildcard tests/*.h) build/$(1)/subjects.h
	$(2) $$(TEST_FLAGS) $(3) -c $$< -o $$@
build/$(1)/inside.c: build/$(1)/subjects.h
	@{ printf '#define %s\n' HYDRA_IMPLEMENTATION $(5:hydra_vk.h=HYDRA_VK_IMPLEMENTATION); \
		printf '#include "%s"\n' hydra.h $(5) $(patsubst %,tests/test_%.c,$(filter $(INSIDE),$(4))); } > $$@
build/$(1)/inside.o: build/$(1)/inside.c hydra.h $(5) $(wildcard tests/*.h) $(patsubst %,tests/test_%.c,$(filter $(INSIDE),$(4)))
	$(2) $$(TEST_FLAGS) $(3) -c $$< -o $$@
build/$(1)/tests: build/$(1)/main.o build/$(1)/inside.o $(patsubst %,build/$(1)/%.o,$(filter-out $(if $(5),,vk_% kernels_%),$(SUPPORT)) $(addprefix test_,$(filter-out $(INSIDE),$(4))))
	$(2) $(3) $$^ -o $$@ -lcmocka $$(LIBS) $(5:hydra_vk.h=-ldl)
endef
SANITIZE := -O1 -fno-omit-frame-pointer
$(eval $(call flavour,unit,$(CC),$(OPT),$(SUBJECTS)))
$(eval $(call flavour,asan,$(CC),$(SANITIZE) -fsanitize=address -fsanitize=undefined -fno-sanitize-recover=all,$(SUBJECTS)))
$(eval $(call flavour,tsan,$(CC),$(SANITIZE) -fsanitize=thread,$(TSAN_SUBJECTS)))
# Those that ask for every bit, and cast rays that are unsound: clang's fast-math takes comparisons at their word.
FAST_SUBJECTS := lanes queries bvh_hits
$(eval $(call flavour,fast,$(CLANG),-O2 -ffast-math,$(FAST_SUBJECTS)))

$(eval $(call flavour,vk,$(CC),$(OPT) -DHT_VULKAN,$(VK_SUBJECTS),hydra_vk.h))

# What test_vk_kernels.c runs on a device, by groups, as arrays of words; and its oracle.
KERNEL_SOURCES := $(patsubst %,tests/kernels_%.h,list plain seeing) $(wildcard shaders/shared/*.h)
build/vk/kernels_double.o: $(KERNEL_SOURCES)
build/vk/inside.o: build/vk/kernels_spirv.h
build/vk/kernels_spirv.h: tests/kernels.comp $(KERNEL_SOURCES) | setup-shaders
	@mkdir -p $(@D)
	@for group in 0 1 2 3 4 5 6 7; do \
		glslangValidator -V --quiet --target-env vulkan1.2 -Ishaders/shared -Itests -DKT_GROUP=$$group $< -o $@.plain >&2 && \
			spirv-opt -O --target-env=vulkan1.2 $@.plain -o $@.words && spirv-val --target-env vulkan1.2 $@.words || exit 1; \
		echo "static const uint32_t kernels_spirv_$$group[] = {"; od -An -v -w48 -tu4 $@.words | sed 's/^ *//; s/  */,/g; s/$$/,/'; echo '};'; \
	done > $@

unit: unit-program
	@build/unit/tests $(T)
# Mesa keeps the machine code of shaders in a folder: one of ours.
unit-vk: vk-program
	@MESA_SHADER_CACHE_DIR=$(CURDIR)/build/vk/shader_cache tests/checks/unit_vk.sh build/vk/tests $(or $(T),$(VK_SUBJECTS))
test-asan: asan-program
	@HYDRA_TEST_QUICK=1 ASAN_OPTIONS=detect_leaks=1 UBSAN_OPTIONS=print_stacktrace=1 build/asan/tests $(T)
test-tsan: $(if $(TSAN_SUBJECTS),tsan-program)
	@test -n "$(TSAN_SUBJECTS)" || { echo "test-tsan: FAILED, no test starts a thread"; exit 1; }
	@HYDRA_TEST_QUICK=1 TSAN_OPTIONS=halt_on_error=1 build/tsan/tests

test-fast: fast-program
	@HYDRA_TEST_QUICK=1 build/fast/tests $(T)

# ---- checks

check-generated check-prefix check-shared check-matrix: check-%:
	@tests/checks/$*.sh
test-readme:
	@tests/checks/readme.sh

test: setup-test
	@MAKE="$(MAKE)" EXAMPLES="$(EXAMPLES)" tests/checks/all.sh

# ---- fuzz

FUZZ_SECONDS ?= 20
FUZZERS := $(patsubst tests/fuzz/%.c,build/fuzz/%,$(wildcard tests/fuzz/fuzz_*.c))
build/fuzz/%: tests/fuzz/%.c hydra.h $(wildcard tests/fuzz/*.h)
	@mkdir -p $(@D)
	$(CLANG) -std=c11 -g -O1 -Wall -Wextra -I. -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=all $< -o $@ $(LIBS)
fuzz: setup-fuzz $(FUZZERS)
	@for target in $(FUZZERS); do \
		corpus=$$target.corpus; echo "== $$target, $(FUZZ_SECONDS) s"; \
		test -d $$corpus || { mkdir -p $$corpus; for seed in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16; do \
			LC_ALL=C awk -v seed=$$seed 'BEGIN { srand(seed); for (i = 0; i < 1500; i++) printf "%c", 1 + int(rand() * 255) }' > $$corpus/$$seed; \
		done; }; \
		$$target -max_total_time=$(FUZZ_SECONDS) -timeout=20 -rss_limit_mb=4096 -max_len=4096 -len_control=0 -print_final_stats=1 \
			-artifact_prefix=build/fuzz/ $$corpus > $$target.log 2>&1 || { tail -n 40 $$target.log; exit 1; }; \
		grep -E 'stat::(number_of_executed|average_exec|peak_rss)' $$target.log; \
	done

# ---- style

SOURCES := $(filter-out hydra.h hydra_vk.h,$(shell find src shaders tools examples tests bench -name '*.[ch]' 2>/dev/null))
format: setup-lint
	clang-format -i $(SOURCES)
tidy: setup-lint
	clang-tidy --quiet tools/amalgamate.c tests/main.c tests/hydra_test.c -- $(TEST_FLAGS) -Ibuild/unit
	clang-tidy --quiet hydra.h -- -x c -std=c99 -DHYDRA_IMPLEMENTATION

clean:
	rm -rf build
